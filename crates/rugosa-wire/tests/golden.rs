//! The bytes of every kind of message, and the worked example of docs/wire-format.md:
//! what was once sent must be read for ever, unless `PROTOCOL` is raised.
//!
//! After raising it, or adding a counter: `BLESS=1 cargo test -p rugosa-wire --test golden`.

mod common;

use common::*;
use rugosa_wire::*;
use std::fmt::Write;

const GOLDEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden.txt");
const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/wire-format.md");

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex
        .chars()
        .filter_map(|c| c.to_digit(16).map(|d| d as u8))
        .collect();
    digits
        .chunks(2)
        .map(|pair| pair[0] << 4 | pair[1])
        .collect()
}

fn message_bytes(message: &Message) -> Vec<u8> {
    postcard::to_slice(message, &mut [0; MAX_MESSAGE])
        .unwrap()
        .to_vec()
}

/// The example of the document: three returns of a 12-bit scanner.
fn example() -> Message {
    Message::Line(ScanLine {
        sweep: 2,
        line: 130,
        first_column: 0,
        stamp_us: 1_000_000,
        returns: 3,
        packing: Packing::Bits12,
        ranges: Packing::Bits12.pack([0x123, 0x800, 0xfff]).unwrap(),
        reflectances: Default::default(),
    })
}

/// The schema hash in a greeting changes with the schema; the rest does not.
fn samples() -> Vec<Message> {
    let mut all = longest();
    for message in &mut all {
        if let Message::Hello(hello) = message {
            hello.schema = 0x0102_0304;
        }
    }
    all.push(example());
    all
}

#[test]
fn messages_have_the_bytes_they_always_had() {
    let now: String = samples()
        .iter()
        .map(|m| format!("{} {}\n", m.kind(), hex(&message_bytes(m))))
        .collect();
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(GOLDEN, &now).unwrap();
    }
    let golden = std::fs::read_to_string(GOLDEN).unwrap();
    assert_eq!(golden, now);
    for (line, sample) in golden.lines().zip(samples()) {
        let (_, encoded) = line.split_once(' ').unwrap();
        let decoded: Message = postcard::from_bytes(&bytes(encoded)).unwrap();
        assert_eq!(decoded, sample);
    }
}

#[test]
fn every_kind_of_message_is_among_them() {
    let variants: std::collections::BTreeSet<u8> =
        samples().iter().map(|m| message_bytes(m)[0]).collect();
    assert_eq!(variants, (0..18).collect());
    assert!(
        postcard::from_bytes::<Message>(&[18]).is_err(),
        "a kind without a sample"
    );
}

/// The value of a line `name: hex …` in the document.
fn documented(document: &str, name: &str) -> Vec<u8> {
    let line = document.lines().find_map(|line| line.strip_prefix(name));
    bytes(line.unwrap_or_else(|| panic!("no line {name:?} in {DOCUMENT}")))
}

#[test]
fn the_worked_example_of_the_document_is_right() {
    let document = std::fs::read_to_string(DOCUMENT).unwrap();
    let body = documented(&document, "header and message: ");
    let (header, message) = body.split_at(5);
    assert_eq!(hex(header), hex(&[0xb9, 0xbf, 0x03, 0xac, 0x02]));
    assert_eq!(hex(message), hex(&message_bytes(&example())));
    let check = documented(&document, "CRC-32, little-endian: ");
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    assert_eq!(hex(&crc.checksum(&body).to_le_bytes()), hex(&check));
    let whole = documented(&document, "frame: ");
    assert_eq!(hex(&frame(57_273, 300, &example())), hex(&whole));
    assert_eq!(
        hex(&cobs::decode_vec_of(&whole)),
        hex(&[body, check].concat())
    );
}

mod cobs {
    pub fn decode_vec_of(frame: &[u8]) -> Vec<u8> {
        let mut bytes = frame[..frame.len() - 1].to_vec();
        let length = ::cobs::decode_in_place(&mut bytes).unwrap();
        bytes.truncate(length);
        bytes
    }
}

#[test]
fn limits_and_times_in_the_document_are_those_of_the_code() {
    let document = std::fs::read_to_string(DOCUMENT).unwrap();
    for said in [
        format!("at most **{MAX_FRAME}** bytes"),
        format!("protocol **{PROTOCOL}**"),
        format!("every {} ms", handshake::RETRY_US / 1000),
        format!("after {} ms without", handshake::HEARTBEAT_US / 1000),
        format!("after {} ms of waiting", handshake::STALL_US / 1000),
        format!("for {} s", handshake::SILENCE_US / 1_000_000),
    ] {
        assert!(
            document.contains(&said),
            "the document does not say {said:?}"
        );
    }
}

/// The document's table of counters.
fn counter_table() -> String {
    let rows = counter::NAMES.iter().zip(counter::MEANINGS).enumerate();
    rows.map(|(i, (name, meaning))| format!("| {i} | `{name}` | {meaning} |\n"))
        .collect()
}

#[test]
fn all_counters_are_in_the_document() {
    let document = std::fs::read_to_string(DOCUMENT).unwrap();
    let start = document.find("| 0 | `link.bytes`").unwrap();
    let length = document[start..].find("\n\n").unwrap() + 1;
    let (before, after) = (&document[..start], &document[start + length..]);
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(DOCUMENT, format!("{before}{}{after}", counter_table())).unwrap();
    } else {
        assert_eq!(&document[start..start + length], counter_table());
    }
}
