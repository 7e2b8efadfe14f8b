//! Fingerprints of an x86-64 host, written by `examples/bless.rs`.

pub const SQRT: u32 = 0x7e653743;
pub const CIRCULAR: u32 = 0x985299da;
pub const ARCS: u32 = 0xc3aec57d;
pub const LOGARITHMS: u32 = 0x89e5b343;
pub const EXPONENTIALS: u32 = 0x43de1cd3;
pub const POWERS: u32 = 0x5e9e36f3;
pub const ERROR_FUNCTION: u32 = 0x0d560c73;
pub const ROUNDING: u32 = 0xff4abdcb;
pub const CODEC_EXACT: u32 = 0x9df64c81;
pub const CODEC_ROUNDED: u32 = 0xa711a3db;
pub const CODEC_QUICK: u32 = 0xd620dce6;
