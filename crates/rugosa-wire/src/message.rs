//! Messages of the link, in raw device units.
//!
//! The order of the variants and of the fields is the wire format (postcard numbers
//! them); it changes only together with [`crate::PROTOCOL`].

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

/// Most returns in one [`ScanLine`]; longer lines are cut into segments.
pub const MAX_RETURNS: usize = 256;
/// Most bytes of packed ranges in one line (16 bits per return).
pub const MAX_RANGE_BYTES: usize = MAX_RETURNS * 2;
/// Most values in one [`BeamTable`].
pub const MAX_TABLE: usize = 64;
/// Most values in one [`Patch`]: one tile of 8 × 8 cells.
pub const MAX_PATCH: usize = 64;
/// Most bytes of an [`Message::Echo`].
pub const MAX_ECHO: usize = 64;

/// Everything that travels over the link.
///
/// ```
/// use rugosa_wire::{BeamTable, Message, PoseStamp, TableKind};
/// let pose = Message::Pose(PoseStamp {
///     stamp_us: 1500,
///     position_m: [1.0, 2.0, 0.0],
///     orientation: [0.0, 0.0, 0.0, 1.0], // x, y, z, w
/// });
/// assert_eq!((pose.kind(), pose.stamp_us(), pose.is_on_credit()), ("pose", Some(1500), false));
/// let angles_urad = heapless::Vec::from_slice(&[-100_000, 100_000]).unwrap();
/// let kind = TableKind::Inclination;
/// let table = Message::BeamTable(BeamTable { kind, first: 0, angles_urad });
/// assert_eq!((table.stamp_us(), table.is_on_credit()), (None, true));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)]
pub enum Message {
    /// who speaks, and which protocol
    Hello(Hello),
    /// the scanner's beams and noise
    Scanner(ScannerDescription),
    /// angles that are not on a regular raster
    BeamTable(BeamTable),
    /// one scan line or a segment of it
    Line(ScanLine),
    /// where the body was at one instant
    Pose(PoseStamp),
    /// the field of view is covered once
    SweepEnd(SweepEnd),
    /// all counters
    Status(Status),
    /// values of one layer in one tile
    Patch(Patch),
    /// one parameter to be set
    Configure(Configure),
    /// the answer to a message that asks for one
    Ack(Ack),
    /// the receiver can take `lines` more scan lines
    Credit(Credit),
    /// still there
    Heartbeat(Heartbeat),
    /// self-test: send these bytes back
    Echo(#[serde(with = "crate::bytes")] Vec<u8, MAX_ECHO>),
    /// self-test: the answer to an echo
    EchoReply(#[serde(with = "crate::bytes")] Vec<u8, MAX_ECHO>),
    /// self-test: send `count` messages of kind [`Message::Sink`]
    Source {
        /// how many
        count: u32,
    },
    /// self-test: counted and thrown away
    Sink {
        /// running number
        index: u32,
        /// anything
        #[serde(with = "crate::bytes")]
        filler: Vec<u8, MAX_ECHO>,
    },
    /// send the whole map again (after a restart of the receiver)
    Refresh,
    /// start afresh: forget the map and the counters
    Reset,
}

impl Message {
    /// Name of the kind of message, as in recordings: `line`, `pose`, `sweep_end`, ….
    pub const fn kind(&self) -> &'static str {
        match self {
            Message::Hello(_) => "hello",
            Message::Scanner(_) => "scanner",
            Message::BeamTable(_) => "beam_table",
            Message::Line(_) => "line",
            Message::Pose(_) => "pose",
            Message::SweepEnd(_) => "sweep_end",
            Message::Status(_) => "status",
            Message::Patch(_) => "patch",
            Message::Configure(_) => "configure",
            Message::Ack(_) => "ack",
            Message::Credit(_) => "credit",
            Message::Heartbeat(_) => "heartbeat",
            Message::Echo(_) => "echo",
            Message::EchoReply(_) => "echo_reply",
            Message::Source { .. } => "source",
            Message::Sink { .. } => "sink",
            Message::Refresh => "refresh",
            Message::Reset => "reset",
        }
    }

    /// Is it one of the long messages of a scanner, which are sent on credit only where the
    /// receiver asks for that ([`capability::FLOW_CONTROL`])?
    pub const fn is_on_credit(&self) -> bool {
        matches!(self, Message::Line(_) | Message::BeamTable(_))
    }

    /// Time of a measurement on the scanner's clock, microseconds.
    pub const fn stamp_us(&self) -> Option<u64> {
        match self {
            Message::Line(line) => Some(line.stamp_us),
            Message::Pose(pose) => Some(pose.stamp_us),
            Message::SweepEnd(end) => Some(end.stamp_us),
            _ => None,
        }
    }
}

/// Greeting; both sides repeat it until each knows that the other has heard it.
///
/// Header, variant 0 and the first two fields keep their place in every version of the
/// protocol: that is how a peer of another version is recognised and named.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// version of the protocol, [`crate::PROTOCOL`]
    pub protocol: u16,
    /// hash of the message types, [`crate::schema_hash`]
    pub schema: u32,
    /// session of the peer whose greeting the sender has heard, 0 for none yet
    pub heard: u32,
    /// the sender does not know yet whether it was heard: answer with a greeting
    pub asking: bool,
    /// what the sender is
    pub role: Role,
    /// name of the device
    pub device: String<32>,
    /// version of its software
    pub version: String<16>,
    /// bit set of [`capability`]
    pub capabilities: u32,
    /// side of the map in cells, 0 where there is none
    pub map_side: u16,
    /// map resolution in micrometres, 0 where there is none
    pub resolution_um: u32,
}

impl Role {
    /// All roles.
    ///
    /// ```
    /// use rugosa_wire::Role;
    /// assert_eq!(Role::ALL.map(Role::name), ["scanner", "module", "host"]);
    /// ```
    pub const ALL: [Role; 3] = [Role::Scanner, Role::Module, Role::Host];

    /// Name of the role, as in recordings.
    pub const fn name(self) -> &'static str {
        match self {
            Role::Scanner => "scanner",
            Role::Module => "module",
            Role::Host => "host",
        }
    }
}

impl Hello {
    /// A greeting in this version of the protocol, without capabilities or a map. Names
    /// that are too long are cut off.
    ///
    /// ```
    /// use rugosa_wire::{Hello, PROTOCOL, Role};
    /// let hello = Hello::new(Role::Scanner, &"x".repeat(40), "1.2.3");
    /// assert_eq!((hello.protocol, hello.role), (PROTOCOL, Role::Scanner));
    /// assert_eq!((hello.device.len(), hello.version.as_str()), (32, "1.2.3"));
    /// ```
    pub fn new(role: Role, device: &str, version: &str) -> Self {
        Hello {
            protocol: crate::PROTOCOL,
            schema: crate::schema_hash(),
            heard: 0,
            asking: true,
            role,
            device: cut(device),
            version: cut(version),
            capabilities: 0,
            map_side: 0,
            resolution_um: 0,
        }
    }
}

/// As many characters as fit.
fn cut<const N: usize>(text: &str) -> String<N> {
    let mut kept = String::new();
    let _ = text.chars().try_for_each(|c| kept.push(c));
    kept
}

/// What a peer is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Role {
    /// sends lines
    Scanner,
    /// makes a map of lines
    Module,
    /// reads maps, sends configuration
    Host,
}

/// Bits of [`Hello::capabilities`].
pub mod capability {
    /// makes roughness layers
    pub const ROUGHNESS: u32 = 1;
    /// makes a reconstruction
    pub const RECONSTRUCTION: u32 = 2;
    /// makes traversability layers
    pub const TRAVERSABILITY: u32 = 4;
    /// grants credits
    pub const FLOW_CONTROL: u32 = 8;
}

/// Which geometry turns columns, lines and counts into points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum BeamModel {
    /// azimuth by column (plus an offset by line), inclination by line
    Spherical,
    /// the Perceptron's rotating polygon and nodding mirror; lengths in metres
    Perceptron {
        /// mirror offset h1
        h1_m: f32,
        /// mirror offset h2
        h2_m: f32,
        /// mirror slope γ
        gamma_urad: i32,
        /// mirror slope θ
        theta_urad: i32,
        /// standoff r0 in counts
        standoff_counts: f32,
    },
}

/// The scanner: raster, units, noise and mounting.
///
/// Angles of the raster: azimuth of column c = first + c · step, inclination of line l
/// likewise, unless a [`BeamTable`] overrides them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScannerDescription {
    /// geometry
    pub model: BeamModel,
    /// columns of a complete line
    pub columns: u16,
    /// lines of a complete sweep
    pub lines: u16,
    /// azimuth of column 0 (positive to the left), microradians
    pub azimuth_first_urad: i32,
    /// azimuth step per column
    pub azimuth_step_nrad: i32,
    /// inclination of line 0 (positive up), microradians
    pub inclination_first_urad: i32,
    /// inclination step per line
    pub inclination_step_nrad: i32,
    /// tables that follow and must be complete before the first line
    pub tables: u8,
    /// length of one range count, metres
    pub metres_per_count: f32,
    /// shortest valid range, metres
    pub range_min_m: f32,
    /// longest valid range, metres
    pub range_max_m: f32,
    /// standard deviation of a range: constant part, metres
    pub range_noise_m: f32,
    /// standard deviation of a range: part that grows with it, metres per metre
    pub range_noise_per_m: f32,
    /// standard deviation of a beam's direction, microradians
    pub angle_noise_urad: u32,
    /// time between the columns of a line, nanoseconds
    pub column_period_ns: u32,
    /// time between the lines of a sweep, microseconds
    pub line_period_us: u32,
    /// sensor in the body frame: translation, metres
    pub mount_position_m: [f32; 3],
    /// sensor in the body frame: unit quaternion (x, y, z, w)
    pub mount_orientation: [f32; 4],
}

/// Bits of [`ScannerDescription::tables`], one per [`TableKind`].
pub mod table_bit {
    /// inclination by line
    pub const INCLINATION: u8 = 1;
    /// azimuth offset by line
    pub const AZIMUTH_OFFSET: u8 = 2;
    /// azimuth by column
    pub const AZIMUTH: u8 = 4;
}

/// Which table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TableKind {
    /// inclination by line
    Inclination,
    /// azimuth offset by line, added to the column's azimuth
    AzimuthOffset,
    /// azimuth by column
    Azimuth,
}

/// A piece of a table of angles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BeamTable {
    /// which table
    pub kind: TableKind,
    /// line or column of the first value
    pub first: u16,
    /// angles, microradians
    pub angles_urad: Vec<i32, MAX_TABLE>,
}

/// How ranges are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Packing {
    /// two returns in three bytes, little-endian: low 8, then high 4 | low 4, then high 8
    Bits12,
    /// one return in two bytes, little-endian
    Bits16,
}

/// One scan line, or a segment of one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScanLine {
    /// running number of the sweep
    pub sweep: u32,
    /// line within the sweep
    pub line: u16,
    /// column of the first return
    pub first_column: u16,
    /// time of the first return, microseconds of the scanner's clock
    pub stamp_us: u64,
    /// returns in this segment, at most [`MAX_RETURNS`]
    pub returns: u16,
    /// how `ranges` and `reflectances` are packed
    pub packing: Packing,
    /// packed range counts; the codes of [`range_code`] have a meaning of their own
    #[serde(with = "crate::bytes")]
    pub ranges: Vec<u8, MAX_RANGE_BYTES>,
    /// packed reflectances, as many as ranges, or empty
    #[serde(with = "crate::bytes")]
    pub reflectances: Vec<u8, MAX_RANGE_BYTES>,
}

/// Sentinels among range counts (REP-117), given for 12 and for 16 bits as `MAX − k`.
pub mod range_code {
    /// nothing came back (+∞)
    pub const NO_RETURN: u16 = 0;
    /// closer than the scanner can measure (−∞)
    pub const TOO_CLOSE: u16 = 1;
    /// not a measurement (NaN)
    pub const ERRONEOUS: u16 = 2;
}

/// The body in the map frame at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseStamp {
    /// microseconds of the scanner's clock
    pub stamp_us: u64,
    /// position, metres
    pub position_m: [f32; 3],
    /// unit quaternion (x, y, z, w)
    pub orientation: [f32; 4],
}

/// End of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SweepEnd {
    /// running number of the sweep
    pub sweep: u32,
    /// time of its end, microseconds
    pub stamp_us: u64,
    /// line messages that were sent in it
    pub lines: u16,
}

/// Number of counters in a [`Status`].
pub const COUNTERS: usize = 64;

/// All counters of the sender, by [`crate::counter`] index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// last sweep that is complete in the map
    pub sweep: u32,
    /// time since start, microseconds
    pub uptime_us: u64,
    /// counters, see [`crate::counter`]
    pub counters: Vec<u32, COUNTERS>,
}

/// Values of one layer in one tile; −32768 stands for unknown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Patch {
    /// which layer, the number of `rugosa::Layer`
    pub layer: u8,
    /// sweep after which it was taken
    pub sweep: u32,
    /// absolute column of the first value
    pub x: i32,
    /// absolute row of the first value
    pub y: i32,
    /// values per row; the rows follow to the north
    pub width: u8,
    /// cells per value and axis (1 for cell layers, 8 for tile layers)
    pub stride: u8,
    /// value = offset + scale · number
    pub scale: f32,
    /// value = offset + scale · number
    pub offset: f32,
    /// numbers
    pub values: Vec<i16, MAX_PATCH>,
}

/// Sets one parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configure {
    /// number of the parameter, see `rugosa::Config`
    pub parameter: u8,
    /// its value in SI units
    pub value: f32,
}

/// Answer to a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ack {
    /// sequence number of the frame that is answered
    pub sequence: u16,
    /// what became of it
    pub verdict: Verdict,
}

/// What became of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// done
    Accepted,
    /// the peer speaks another protocol; it is [`crate::PROTOCOL`]
    WrongVersion,
    /// no such parameter
    UnknownParameter,
    /// outside the parameter's range
    OutOfRange,
    /// not now: greet first
    NotReady,
    /// cannot be done by this device
    Unsupported,
}

/// Flow control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Credit {
    /// lines and tables taken so far in this session
    pub taken: u32,
    /// lines and tables that may be sent in all in this session
    pub limit: u32,
}

/// Sign of life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// time since start, microseconds
    pub uptime_us: u64,
    /// lines and tables sent so far in this session; the link keeps order, so the receiver
    /// knows that those it has not seen are lost and grants credit for others
    pub lines: u32,
}
