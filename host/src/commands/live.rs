//! `rugosa live`: what `scan` does, to be watched in a browser.

use super::scan;
use super::session::Live;
use crate::console::Console;
use crate::error::Result;
use crate::view::live::LOOPBACK;
use std::net::SocketAddr;

/// Map what a scanner on a serial port sends, and show the map in a browser as it grows.
#[derive(Debug, clap::Args)]
#[group(skip)]
#[command(after_help = "\
Examples:
  rugosa live --port /dev/ttyACM0
  rugosa live --port /tmp/scanner --out map --report
  rugosa live --port /dev/ttyACM0 --listen 0.0.0.0:8645

Only this machine can look unless --listen says otherwise. The server never listens to what
a browser says, refuses pages of other origins, and serves 8 browsers at a time.")]
pub struct Args {
    #[command(flatten)]
    scan: scan::Args,

    /// Address and port of the page
    #[arg(long, value_name = "ADDRESS", default_value = LOOPBACK)]
    listen: SocketAddr,
}

/// Serves the port and the page.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    scan::serve(
        &args.scan,
        Some(Live::start(args.listen, console)?),
        console,
    )
}
