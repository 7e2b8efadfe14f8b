//! What must hold for any bytes from outside. Shared by tests/hostile.rs, which runs it on
//! the seeds of fuzz/corpus and on random changes of them, and by the fuzz targets.

use rugosa_wire::{
    Broken, Credit, Decoder, Frame, Header, Heartbeat, Hello, Link, MAX_FRAME, Message, Role,
    capability, encode,
};

fn pull(decoder: &mut Decoder, mut bytes: &[u8]) -> Vec<Result<Frame, Broken>> {
    std::iter::from_fn(|| decoder.pull(&mut bytes)).collect()
}

/// Any bytes (after one that says how long the chunks are): no panic, the same frames for
/// all chunkings, every frame that comes out can be encoded and decoded again.
pub fn decoder(data: &[u8]) {
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
        if let Message::Line(line) = &frame.message {
            let _ = line.readings().map(|readings| readings.count());
            let _ = line.reflectance_counts().map(|counts| counts.count());
        }
    }
}

fn frame(bytes: &[u8], ours: u32) -> Option<([u8; MAX_FRAME], usize)> {
    let &[kind, session, sequence, a, b, ..] = bytes else {
        return None;
    };
    let message = match kind % 6 {
        0 | 1 => Message::Hello(Hello {
            heard: if a % 2 == 0 { ours } else { u32::from(b) },
            asking: a % 4 < 2,
            capabilities: capability::FLOW_CONTROL * u32::from(b % 2),
            ..Hello::new(Role::Scanner, "fuzz", "1")
        }),
        2 => Message::Credit(Credit {
            taken: u32::from(a).wrapping_neg(),
            limit: u32::from(b) << (a % 32),
        }),
        3 => Message::Heartbeat(Heartbeat {
            uptime_us: 0,
            lines: u32::from(b) << (a % 32),
        }),
        4 => Message::Refresh,
        _ => return None,
    };
    let header = Header {
        session: u32::from(session % 3),
        sequence: u16::from(sequence) << (a % 9),
    };
    let mut buffer = [0; MAX_FRAME];
    let length = encode(&header, &message, &mut buffer).ok()?;
    Some((buffer, length))
}

/// A link under any bytes and any passage of time: no panic, an end to what it has to say,
/// and whatever it sends is understood. The input is a list of (time step, length, bytes);
/// where the step is odd the bytes become a good frame, so that the handshake is passed.
pub fn link(data: &[u8]) {
    let mut hello = Hello::new(Role::Module, "fuzz", "1");
    hello.capabilities = capability::FLOW_CONTROL;
    let mut link = Link::new(hello, 7);
    let (mut now_us, mut rest, mut peer) = (0u64, data, Decoder::new());
    while let [step, length, more @ ..] = rest {
        let (bytes, tail) = more.split_at(more.len().min(usize::from(*length)));
        rest = tail;
        now_us += u64::from(*step) * 20_000;
        let good = frame(bytes, 7).filter(|_| step % 2 == 1);
        let mut input = good.as_ref().map_or(bytes, |(buffer, n)| &buffer[..*n]);
        while link.receive(&mut input, now_us).is_some() {}
        link.offer(u16::from(*length));
        let mut buffer = [0; MAX_FRAME];
        for _ in 0..4 {
            let n = link.tend(now_us, &mut buffer);
            let mut sent = &buffer[..n];
            assert!(peer.pull(&mut sent).is_none_or(|frame| frame.is_ok()));
        }
        assert_eq!(link.tend(now_us, &mut buffer), 0);
        if let Ok(n) = link.send(&Message::Reset, now_us, &mut buffer) {
            assert!(peer.pull(&mut &buffer[..n]).unwrap().is_ok());
        }
    }
    assert_eq!(peer.counts().broken(), 0);
}
