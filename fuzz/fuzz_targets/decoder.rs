//! Any bytes in any chunks: no panic, the same frames for all chunkings, every frame that
//! comes out can be encoded and decoded again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rugosa_wire::{Broken, Decoder, Frame, MAX_FRAME, encode};

fn pull(decoder: &mut Decoder, mut bytes: &[u8]) -> Vec<Result<Frame, Broken>> {
    std::iter::from_fn(|| decoder.pull(&mut bytes)).collect()
}

fuzz_target!(|data: &[u8]| {
    let Some((&size, bytes)) = data.split_first() else {
        return;
    };
    let (mut whole, mut chunked) = (Decoder::new(), Decoder::new());
    let frames = pull(&mut whole, bytes);
    let pieces = bytes.chunks(usize::from(size) + 1);
    let again: Vec<_> = pieces.flat_map(|piece| pull(&mut chunked, piece)).collect();
    // NaN differs from itself: the text does not
    assert_eq!(format!("{frames:?}"), format!("{again:?}"));
    assert_eq!(whole.counts(), chunked.counts());
    assert_eq!(whole.counts().bytes as usize, bytes.len());

    for frame in frames.into_iter().flatten() {
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&frame.header, &frame.message, &mut buffer).unwrap();
        let back = pull(&mut Decoder::new(), &buffer[..length]);
        assert_eq!(format!("{back:?}"), format!("[Ok({frame:?})]"));
        if let rugosa_wire::Message::Line(line) = &frame.message {
            let _ = line.readings().map(|readings| readings.count());
            let _ = line.reflectance_counts().map(|counts| counts.count());
        }
    }
});
