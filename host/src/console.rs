//! What a command says, and where: results on standard output, everything else
//! (progress, notes, errors) on standard error.
//!
//! With `--json` standard output carries one object and nothing else; with `--quiet`
//! standard error carries errors and nothing else. Progress is a moving line on a
//! terminal and, where standard error is a file or a pipe, a plain line every few
//! seconds.

use crate::error::{Failure, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::fmt::Display;
use std::io::{ErrorKind, IsTerminal, Write, stderr, stdout};
use std::time::{Duration, Instant};

/// Time between plain progress lines.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// Time between two pictures of a spinner.
const SPIN: Duration = Duration::from_millis(200);

/// The two streams and the switches `--quiet` and `--json`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Console {
    /// nothing but errors on standard error
    pub quiet: bool,
    /// one JSON object on standard output
    pub json: bool,
}

impl Console {
    /// Prints the result of a command: `report` as one JSON object, or else `text`.
    pub fn result(&self, report: &impl Serialize, text: impl Display) -> Result<()> {
        if !self.json {
            return print(format_args!("{text}"));
        }
        let object = serde_json::to_string_pretty(report).map_err(Failure::runtime)?;
        print(format_args!("{object}"))
    }

    /// A remark on standard error.
    pub fn note(&self, text: impl Display) {
        if !self.quiet {
            eprintln!("{text}");
        }
    }

    /// Progress of a long job; `total` units where that is known.
    pub fn progress(&self, label: &str, total: Option<u64>) -> Progress {
        let plain = !self.quiet && !stderr().is_terminal();
        let bar = ProgressBar::with_draw_target(total, self.draw_target());
        bar.set_style(style(total.is_some()));
        bar.set_prefix(label.to_owned());
        if total.is_none() {
            bar.enable_steady_tick(SPIN);
        }
        Progress {
            bar,
            plain,
            last: Instant::now(),
        }
    }

    fn draw_target(&self) -> ProgressDrawTarget {
        if self.quiet {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(10)
        }
    }
}

fn style(bounded: bool) -> ProgressStyle {
    let template = if bounded {
        "{prefix} {bar:24} {percent:>3} % {msg} ({eta} left)"
    } else {
        "{prefix} {spinner} {elapsed} {msg}"
    };
    ProgressStyle::with_template(template).expect("a constant template")
}

/// A progress display; it goes away when dropped.
pub struct Progress {
    bar: ProgressBar,
    plain: bool,
    last: Instant,
}

impl Progress {
    /// Sets the position and what stands beside it. `message` is only called when
    /// something is shown.
    pub fn set<M: Display>(&mut self, position: u64, message: impl FnOnce() -> M) {
        self.bar.set_position(position);
        if self.plain && self.last.elapsed() >= PLAIN_INTERVAL {
            self.last = Instant::now();
            eprintln!("{} {position} {}", self.bar.prefix(), message());
        } else if !self.bar.is_hidden() {
            self.bar.set_message(message().to_string());
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Writes a line to standard output; a reader that went away is no error.
fn print(text: impl Display) -> Result<()> {
    match writeln!(stdout().lock(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::runtime(format_args!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}
