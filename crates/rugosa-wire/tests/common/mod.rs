//! Arbitrary, fixed and longest messages, shared by the tests of this crate.
#![allow(dead_code)]

use heapless::{String, Vec};
use proptest::collection::vec;
use proptest::prelude::*;
use rugosa_wire::*;

/// The frames of some messages, one after the other, sequence numbers from 0.
pub fn stream(session: u32, messages: &[Message]) -> std::vec::Vec<u8> {
    let mut bytes = std::vec::Vec::new();
    for (i, message) in messages.iter().enumerate() {
        bytes.extend(frame(session, i as u16, message));
    }
    bytes
}

/// One frame.
pub fn frame(session: u32, sequence: u16, message: &Message) -> std::vec::Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    let header = Header { session, sequence };
    let length = encode(&header, message, &mut buffer).unwrap();
    buffer[..length].to_vec()
}

/// Everything a decoder makes of some bytes.
pub fn pull_all(decoder: &mut Decoder, mut bytes: &[u8]) -> std::vec::Vec<Result<Frame, Broken>> {
    core::iter::from_fn(|| decoder.pull(&mut bytes)).collect()
}

/// A text of ASCII letters.
pub fn text<const N: usize>(s: &str) -> String<N> {
    String::try_from(s).unwrap()
}

/// A greeting in this version of the protocol.
pub fn hello() -> Hello {
    Hello {
        protocol: PROTOCOL,
        schema: schema_hash(),
        heard: 0,
        asking: true,
        role: Role::Module,
        device: text("rugosa mps2-an386"),
        version: text("0.1.0"),
        capabilities: capability::ROUGHNESS | capability::FLOW_CONTROL,
        map_side: 65,
        resolution_um: 100_000,
    }
}

/// The longest message of every kind.
pub fn longest() -> std::vec::Vec<Message> {
    let bytes = Vec::from_slice(&[0xff; MAX_RANGE_BYTES]).unwrap();
    let echo = Vec::from_slice(&[0xff; MAX_ECHO]).unwrap();
    vec![
        Message::Hello(Hello {
            heard: u32::MAX,
            device: text("12345678901234567890123456789012"),
            version: text("1234567890123456"),
            capabilities: u32::MAX,
            map_side: u16::MAX,
            resolution_um: u32::MAX,
            ..hello()
        }),
        Message::Scanner(ScannerDescription {
            model: BeamModel::Perceptron {
                h1_m: f32::MAX,
                h2_m: f32::MAX,
                gamma_urad: i32::MIN,
                theta_urad: i32::MIN,
                standoff_counts: f32::MAX,
            },
            columns: u16::MAX,
            lines: u16::MAX,
            azimuth_first_urad: i32::MIN,
            azimuth_step_nrad: i32::MIN,
            inclination_first_urad: i32::MIN,
            inclination_step_nrad: i32::MIN,
            tables: 7,
            metres_per_count: 1.0,
            range_min_m: 1.0,
            range_max_m: 1.0,
            range_noise_m: 1.0,
            range_noise_per_m: 1.0,
            angle_noise_urad: u32::MAX,
            column_period_ns: u32::MAX,
            line_period_us: u32::MAX,
            mount_position_m: [1.0; 3],
            mount_orientation: [1.0; 4],
        }),
        Message::BeamTable(BeamTable {
            kind: TableKind::Azimuth,
            first: u16::MAX,
            angles_urad: Vec::from_slice(&[i32::MIN; MAX_TABLE]).unwrap(),
        }),
        Message::Line(ScanLine {
            sweep: u32::MAX,
            line: u16::MAX,
            first_column: u16::MAX,
            stamp_us: u64::MAX,
            returns: u16::MAX,
            packing: Packing::Bits16,
            ranges: bytes.clone(),
            reflectances: bytes,
        }),
        Message::Pose(PoseStamp {
            stamp_us: u64::MAX,
            position_m: [1.0; 3],
            orientation: [1.0; 4],
        }),
        Message::SweepEnd(SweepEnd {
            sweep: u32::MAX,
            stamp_us: u64::MAX,
            lines: u16::MAX,
        }),
        Message::Status(Status {
            sweep: u32::MAX,
            uptime_us: u64::MAX,
            counters: Vec::from_slice(&[u32::MAX; COUNTERS]).unwrap(),
        }),
        Message::Patch(Patch {
            layer: u8::MAX,
            sweep: u32::MAX,
            x: i32::MIN,
            y: i32::MIN,
            width: u8::MAX,
            stride: u8::MAX,
            scale: 1.0,
            offset: 1.0,
            values: Vec::from_slice(&[i16::MIN; MAX_PATCH]).unwrap(),
        }),
        Message::Configure(Configure {
            parameter: u8::MAX,
            value: 1.0,
        }),
        Message::Ack(Ack {
            sequence: u16::MAX,
            verdict: Verdict::Unsupported,
        }),
        Message::Credit(Credit {
            taken: u32::MAX,
            limit: u32::MAX,
        }),
        Message::Heartbeat(Heartbeat {
            uptime_us: u64::MAX,
            lines: u32::MAX,
        }),
        Message::Echo(echo.clone()),
        Message::EchoReply(echo.clone()),
        Message::Source { count: u32::MAX },
        Message::Sink {
            index: u32::MAX,
            filler: echo,
        },
        Message::Refresh,
        Message::Reset,
    ]
}

fn bytes<const N: usize>() -> impl Strategy<Value = Vec<u8, N>> {
    vec(prop_oneof![Just(0u8), any::<u8>()], 0..=N).prop_map(|v| Vec::from_slice(&v).unwrap())
}

fn list<T: Arbitrary + Clone, const N: usize>() -> impl Strategy<Value = Vec<T, N>> {
    vec(any::<T>(), 0..=N).prop_map(|v| Vec::from_slice(&v).unwrap())
}

fn number() -> impl Strategy<Value = f32> {
    any::<f32>() // proptest leaves NaN and infinity out by default
}

fn line() -> impl Strategy<Value = Message> {
    (any::<(u32, u16, u16, u64, u16, bool)>(), bytes(), bytes()).prop_map(
        |((sweep, line, first_column, stamp_us, returns, wide), ranges, reflectances)| {
            let packing = if wide {
                Packing::Bits16
            } else {
                Packing::Bits12
            };
            Message::Line(ScanLine {
                sweep,
                line,
                first_column,
                stamp_us,
                returns,
                packing,
                ranges,
                reflectances,
            })
        },
    )
}

fn patch() -> impl Strategy<Value = Message> {
    let head = any::<(u8, u32, i32, i32, u8, u8)>();
    (head, number(), number(), list()).prop_map(
        |((layer, sweep, x, y, width, stride), scale, offset, values)| {
            Message::Patch(Patch {
                layer,
                sweep,
                x,
                y,
                width,
                stride,
                scale,
                offset,
                values,
            })
        },
    )
}

fn status() -> impl Strategy<Value = Message> {
    (any::<(u32, u64)>(), list()).prop_map(|((sweep, uptime_us), counters)| {
        Message::Status(Status {
            sweep,
            uptime_us,
            counters,
        })
    })
}

fn pose() -> impl Strategy<Value = Message> {
    (any::<u64>(), any::<[f32; 3]>(), any::<[f32; 4]>()).prop_map(
        |(stamp_us, position_m, orientation)| {
            Message::Pose(PoseStamp {
                stamp_us,
                position_m,
                orientation,
            })
        },
    )
}

fn table() -> impl Strategy<Value = Message> {
    (any::<u16>(), list()).prop_map(|(first, angles_urad)| {
        Message::BeamTable(BeamTable {
            kind: TableKind::AzimuthOffset,
            first,
            angles_urad,
        })
    })
}

/// Any message.
pub fn message() -> impl Strategy<Value = Message> {
    prop_oneof![
        4 => line(),
        2 => patch(),
        1 => status(),
        1 => pose(),
        1 => table(),
        1 => (0..longest().len()).prop_map(|i| longest()[i].clone()),
        1 => bytes().prop_map(Message::Echo),
        1 => any::<u32>().prop_map(|heard| Message::Hello(Hello { heard, ..hello() })),
        1 => any::<(u32, u32)>().prop_map(|(taken, limit)| Message::Credit(Credit { taken, limit })),
    ]
}
