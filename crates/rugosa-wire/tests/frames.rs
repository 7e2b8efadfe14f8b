//! Frames under arbitrary messages, arbitrary bytes and arbitrary damage.

mod common;

use common::*;
use proptest::collection::vec;
use proptest::prelude::*;
use rugosa_wire::*;

#[test]
fn no_message_is_longer_than_stated() {
    let lengths: Vec<_> = longest()
        .iter()
        .map(|m| postcard::to_slice(m, &mut [0; 4096]).unwrap().len())
        .collect();
    assert_eq!(lengths.iter().max(), Some(&MAX_MESSAGE), "{lengths:?}");
    let frames = longest()
        .iter()
        .map(|m| frame(u32::MAX, u16::MAX, m).len())
        .max();
    assert!(
        frames.unwrap() <= MAX_FRAME && frames.unwrap() + 1 >= MAX_FRAME,
        "{frames:?}"
    );
}

#[test]
fn a_buffer_that_is_too_short_is_an_error() {
    let message = Message::Echo(heapless::Vec::from_slice(&[1; 40]).unwrap());
    let length = frame(9, 9, &message).len();
    let header = Header {
        session: 9,
        sequence: 9,
    };
    for short in 0..length {
        assert_eq!(
            encode(&header, &message, &mut vec![0; short]),
            Err(BufferFull)
        );
    }
    assert_eq!(encode(&header, &message, &mut vec![0; length]), Ok(length));
}

#[test]
fn broken_frames_are_told_apart() {
    let good = frame(1, 0, &Message::Refresh);
    let mut decoder = Decoder::new();
    let mut changed = good.clone();
    changed[3] ^= 4;
    assert_eq!(pull_all(&mut decoder, &changed), [Err(Broken::Crc)]);
    assert_eq!(pull_all(&mut decoder, &[200, 1, 2, 0]), [Err(Broken::Cobs)]);
    assert_eq!(pull_all(&mut decoder, &[1, 1, 0]), [Err(Broken::Cobs)]);
    assert_eq!(
        pull_all(&mut decoder, &sealed(&[1, 0, 99])),
        [Err(Broken::Message)]
    );
    assert_eq!(
        pull_all(&mut decoder, &sealed(&[1, 0, 16, 0])),
        [Err(Broken::Message)]
    );
    assert_eq!(pull_all(&mut decoder, &sealed(&[1, 0, 16])).len(), 1);
    assert_eq!(pull_all(&mut decoder, &[0, 0, 0]), []);
    let counts = decoder.counts();
    assert_eq!(
        (counts.bad_crc, counts.bad_cobs, counts.bad_message),
        (1, 2, 2)
    );
    assert_eq!((counts.frames, counts.broken()), (1, 5));
}

/// A frame with a right check around any content.
fn sealed(content: &[u8]) -> Vec<u8> {
    let mut body = content.to_vec();
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(content);
    body.extend(crc.to_le_bytes());
    let mut frame = vec![0; body.len() + body.len() / 254 + 2];
    let length = cobs::encode(&body, &mut frame);
    frame.truncate(length);
    frame.push(0);
    frame
}

#[test]
fn the_greeting_of_another_version_is_recognised_whatever_follows() {
    // session 5, sequence 0, variant 0, protocol 9, schema 0x7f, then an unknown rest
    let result = pull_all(
        &mut Decoder::new(),
        &sealed(&[5, 0, 0, 9, 0x7f, 250, 251, 252]),
    );
    let theirs = Version {
        protocol: 9,
        schema: 0x7f,
    };
    assert_eq!(result, [Err(Broken::Version(theirs))]);
    let other_schema = Hello {
        schema: schema_hash() ^ 1,
        ..hello()
    };
    let mut decoder = Decoder::new();
    let result = pull_all(&mut decoder, &frame(5, 0, &Message::Hello(other_schema)));
    assert!(matches!(result[..], [Err(Broken::Version(v))] if v.protocol == PROTOCOL));
    assert_eq!(decoder.counts().unknown_version, 1);
}

#[test]
fn an_over_long_frame_is_discarded_up_to_its_delimiter() {
    // the tail of the over-long frame is a good frame, which must not come out
    let good = frame(1, 0, &Message::Reset);
    for excess in 0..3 * MAX_FRAME {
        let mut bytes = vec![7; MAX_FRAME + excess];
        bytes.extend(&good);
        bytes.extend(&good);
        let mut decoder = Decoder::new();
        let results: Vec<_> = bytes
            .chunks(excess % 61 + 1)
            .flat_map(|chunk| pull_all(&mut decoder, chunk))
            .collect();
        assert_eq!(results.len(), 2);
        assert_eq!(results[0], Err(Broken::OverLong));
        assert!(results[1].is_ok());
        assert_eq!(decoder.counts().over_long, 1);
    }
}

/// What can happen to bytes on their way.
#[derive(Clone, Debug)]
enum Damage {
    Flip(usize, u8),
    Insert(usize, u8),
    Delete(usize, usize),
    Swap(usize, usize),
    Truncate(usize),
}

impl Damage {
    fn apply(&self, bytes: &mut Vec<u8>) {
        let at = |i: usize| i % bytes.len().max(1);
        match *self {
            _ if bytes.is_empty() => {}
            Damage::Flip(i, bit) => {
                let i = at(i);
                bytes[i] ^= 1 << (bit % 8);
            }
            Damage::Insert(i, byte) => bytes.insert(at(i), byte),
            Damage::Delete(i, n) => {
                let (start, end) = (at(i), (at(i) + n % 40).min(bytes.len()));
                bytes.drain(start..end);
            }
            Damage::Swap(i, j) => {
                let (i, j) = (at(i), at(j));
                bytes.swap(i, j);
            }
            Damage::Truncate(n) => bytes.truncate(at(n)),
        }
    }
}

fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        6 => any::<(usize, u8)>().prop_map(|(i, b)| Damage::Flip(i, b)),
        2 => any::<(usize, u8)>().prop_map(|(i, b)| Damage::Insert(i, b)),
        2 => any::<(usize, usize)>().prop_map(|(i, n)| Damage::Delete(i, n)),
        2 => any::<(usize, usize)>().prop_map(|(i, j)| Damage::Swap(i, j)),
        1 => any::<usize>().prop_map(Damage::Truncate),
    ]
}

fn good(results: &[Result<Frame, Broken>]) -> Vec<Frame> {
    results.iter().filter_map(|r| r.clone().ok()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn a_message_comes_back(session: u32, sequence: u16, message in message()) {
        let bytes = frame(session, sequence, &message);
        prop_assert_eq!(bytes.iter().filter(|&&b| b == 0).count(), 1);
        prop_assert_eq!(bytes.last(), Some(&0));
        let results = pull_all(&mut Decoder::new(), &bytes);
        let header = Header { session, sequence };
        prop_assert_eq!(results, vec![Ok(Frame { header, message })]);
    }

    #[test]
    fn chunking_does_not_matter(
        messages in vec(message(), 1..5),
        damage in vec(damage(), 0..3),
        sizes in vec(1usize..700, 1..20),
    ) {
        let mut bytes = stream(3, &messages);
        damage.iter().for_each(|d| d.apply(&mut bytes));
        let mut whole = Decoder::new();
        let expected = pull_all(&mut whole, &bytes);
        let (mut decoder, mut results, mut rest) = (Decoder::new(), Vec::new(), &bytes[..]);
        for size in sizes.iter().cycle() {
            if rest.is_empty() { break }
            let (chunk, more) = rest.split_at((*size).min(rest.len()));
            results.extend(pull_all(&mut decoder, chunk));
            rest = more;
        }
        prop_assert_eq!(results, expected);
        prop_assert_eq!(decoder.counts(), whole.counts());
        prop_assert_eq!(decoder.counts().bytes as usize, bytes.len());
    }

    #[test]
    fn damage_never_makes_a_message_and_the_next_one_arrives(
        messages in vec(message(), 1..5), damage in vec(damage(), 1..8),
    ) {
        let mut bytes = stream(3, &messages);
        damage.iter().for_each(|d| d.apply(&mut bytes));
        bytes.push(0);
        bytes.extend(frame(4, 77, &Message::Refresh));
        let mut decoder = Decoder::new();
        let arrived = good(&pull_all(&mut decoder, &bytes));
        let (last, others) = arrived.split_last().unwrap();
        prop_assert_eq!(last.header, Header { session: 4, sequence: 77 });
        for frame in others {
            let sent = &messages[frame.header.sequence as usize];
            prop_assert_eq!(frame.header.session, 3);
            prop_assert_eq!(&frame.message, sent);
        }
        prop_assert_eq!(decoder.counts().frames as usize, arrived.len());
    }

    #[test]
    fn one_damaged_byte_costs_at_most_the_frames_it_touches(
        messages in vec(message(), 3..6), i: prop::sample::Index, flip in 1u8..,
    ) {
        let mut bytes = stream(3, &messages);
        let i = i.index(bytes.len());
        bytes[i] ^= flip;
        // a frame whose delimiter is hit drags the next one along
        let arrived = good(&pull_all(&mut Decoder::new(), &bytes));
        prop_assert!(arrived.len() + 2 >= messages.len());
    }

    #[test]
    fn any_bytes_are_survived(bytes in vec(prop_oneof![1 => Just(0u8), 9 => any::<u8>()], 0..3000)) {
        let mut decoder = Decoder::new();
        let arrived = good(&pull_all(&mut decoder, &bytes));
        prop_assert!(arrived.is_empty());
        prop_assert_eq!(decoder.counts().bytes as usize, bytes.len());
    }

    #[test]
    fn any_content_with_a_right_check_is_survived(content in vec(any::<u8>(), 0..200)) {
        let _ = pull_all(&mut Decoder::new(), &sealed(&content));
        let mut greeting = vec![1, 0, 0];
        greeting.extend(content);
        let _ = pull_all(&mut Decoder::new(), &sealed(&greeting));
    }
}
