//! The firmware in the emulator against its twin on the host.
//!
//! Needs QEMU and the image; `cargo xtask hil` builds it and runs these.

use anyhow::{Context, Result, ensure};
use rugosa_hil::{Bench, Log, Scene, Schedule, Settings, Summary, image};
use rugosa_hil_sim::faults::Faults;
use rugosa_hil_sim::qemu::{Emulator, EmulatorSettings, Exit};
use rugosa_numerics::CHECKS;
use rugosa_wire::{Configure, Message, Verdict, counter, self_test};
use std::time::Duration;

const LONG: Duration = Duration::from_secs(240);
const SCENE: Scene = Scene {
    lines: 48,
    columns: 48,
    sweeps: 4,
    speed: 0.8,
    seed: 7,
};

fn bench(scene: Scene, to_module: Faults) -> Result<Bench<impl Iterator<Item = Message>>> {
    let (description, messages) = scene.messages()?;
    let settings = Settings {
        image: image("mps2-an386")?,
        to_module,
        from_module: Faults::default(),
        in_board_time: false,
    };
    let mut bench = Bench::start(settings, description, messages)?;
    bench.connect()?;
    Ok(bench)
}

fn run(scene: Scene, faults: Faults) -> Result<Summary> {
    let mut bench = bench(scene, faults)?;
    bench.finish(LONG)?;
    let summary = bench.summary();
    assert_eq!(summary.parity.differences, [""; 0], "{summary:#?}");
    assert!(summary.parity.equal, "{summary:#?}");
    Ok(summary)
}

#[test]
#[ignore = "cargo xtask hil"]
fn on_a_perfect_line_nothing_is_lost_and_every_bit_agrees() -> Result<()> {
    let summary = run(SCENE, Faults::default())?;
    assert_eq!(summary.lines.sent, 4 * 48);
    assert_eq!(summary.lines.received, summary.lines.sent);
    assert_eq!((summary.lines.lost, summary.lines.rejected), (0, 0));
    assert_eq!(summary.parity.sweeps, 4);
    assert!(summary.counters["map.moves"] > 0, "the robot has walked");
    assert!(
        summary.counters["returns.used"] > 4 * 48 * 12,
        "{summary:#?}"
    );
    assert!(summary.parity.values > 4_000, "{}", summary.parity.values);
    assert_eq!(summary.restarts, 0);
    Ok(())
}

/// The module's work after a sweep takes up to half a second, in which six lines come.
#[test]
#[ignore = "cargo xtask hil"]
fn no_line_waits_for_the_work_after_a_sweep() -> Result<()> {
    let scene = Scene {
        lines: 64,
        columns: 256,
        sweeps: 2,
        ..SCENE
    };
    let (description, messages) = scene.messages()?;
    let settings = Settings {
        image: image("mps2-an386")?,
        to_module: Faults::paced(115_200),
        from_module: Faults::paced(115_200),
        in_board_time: true,
    };
    let mut bench = Bench::start(settings, description, messages)?;
    bench.feeder.schedule = Some(Schedule::new(83_333));
    bench.finish(LONG)?;
    let summary = bench.summary();
    assert!(summary.parity.equal, "{summary:#?}");
    assert_eq!((summary.lines.received, summary.lines.lost), (128, 0));
    assert_eq!(
        summary.lines.lateness.map(|l| l.late),
        Some(0),
        "{summary:#?}"
    );
    Ok(())
}

/// Least and most of the 192 lines of about 100 bytes that may be lost, by fault.
#[test]
#[ignore = "cargo xtask hil"]
fn faults_of_the_line_lose_lines_and_corrupt_none() -> Result<()> {
    let errors = |bit_error_rate| Faults {
        bit_error_rate,
        seed: 5,
        ..Faults::default()
    };
    let drops = Faults {
        drop_rate: 0.01,
        seed: 6,
        ..Faults::default()
    };
    let doubles = Faults {
        duplicate_rate: 0.001,
        seed: 8,
        ..Faults::default()
    };
    let jitter = Faults {
        delay: Duration::from_millis(5),
        jitter: Duration::from_millis(5),
        seed: 9,
        ..Faults::default()
    };
    for (name, faults, least, most) in [
        ("no bit errors", errors(0.0), 0, 0),
        ("bit errors 1e-6", errors(1e-6), 0, 4),
        ("bit errors 1e-5", errors(1e-5), 0, 16),
        ("bit errors 1e-4", errors(1e-4), 4, 60),
        ("bit errors 1e-3", errors(1e-3), 80, 192),
        ("0.1 % doubled bytes", doubles, 4, 80),
        ("1 % lost bytes", drops, 80, 192),
        ("late by 5 to 10 ms", jitter, 0, 0),
    ] {
        let mut bench = bench(SCENE, faults)?;
        bench.finish(LONG)?;
        let summary = bench.summary();
        check(&bench, &summary).with_context(|| name.to_owned())?;
        let lost = summary.lines.lost + summary.lines.rejected;
        eprintln!("{name}: {lost} of {} lines lost", summary.lines.sent);
        assert!((least..=most).contains(&lost), "{name}: {summary:#?}");
    }
    Ok(())
}

/// Module and twin agree, every byte and every frame is accounted for.
fn check<M: Iterator<Item = Message>>(bench: &Bench<M>, summary: &Summary) -> Result<()> {
    ensure!(summary.parity.equal, "{summary:#?}");
    let at = |name: &str| u64::from(summary.counters[name]);
    let injected = bench.injected()[0];
    let delivered = at("link.bytes") + at("link.overrun");
    ensure!(
        delivered == injected.bytes_out,
        "{delivered} bytes, {injected:?}"
    );
    // a frame has come through or is known to be missing; of the last ones nobody knows
    let sent = u64::from(bench.feeder.link().tally().frames_sent);
    let unknown = sent.saturating_sub(at("link.frames") + at("link.lost"));
    ensure!(
        at("link.frames") <= sent && unknown <= 12,
        "{unknown} of {sent} frames unknown: {summary:#?}"
    );
    Ok(())
}

#[test]
#[ignore = "cargo xtask hil"]
fn after_a_second_without_a_cable_it_goes_on() -> Result<()> {
    let mut bench = bench(SCENE, Faults::default())?;
    bench.until("half of the lines", LONG, |b| b.feeder.lines > 96)?;
    bench.is_plugged = false;
    bench.for_a_while(Duration::from_secs(1))?;
    bench.is_plugged = true;
    bench.finish(LONG)?;
    let summary = bench.summary();
    check(&bench, &summary)?;
    assert!(bench.injected()[0].cut > 0, "{:?}", bench.injected());
    assert!(summary.lines.lost < 30, "{summary:#?}");
    assert_eq!(summary.counters["sweeps"], 4);
    Ok(())
}

#[test]
#[ignore = "cargo xtask hil"]
fn after_a_reset_in_the_middle_of_a_sweep_it_maps_what_follows() -> Result<()> {
    let mut bench = bench(SCENE, Faults::default())?;
    bench.until("half of a sweep", LONG, |b| b.feeder.lines > 72)?;
    bench.emulator.reset()?;
    bench.reconnect("a new session", LONG)?;
    bench.finish(LONG)?;
    let summary = bench.summary();
    assert!(summary.parity.equal, "{summary:#?}");
    assert_eq!(
        summary.counters["restarts.watchdog"], 1,
        "the reset line counts as that"
    );
    assert!(summary.counters["sweeps"] >= 2, "{summary:#?}");
    Ok(())
}

#[test]
#[ignore = "cargo xtask hil"]
fn a_host_that_does_not_read_for_five_seconds_costs_nothing() -> Result<()> {
    let mut bench = bench(SCENE, Faults::default())?;
    bench.is_listening = false;
    bench.for_a_while(Duration::from_secs(5))?;
    bench.is_listening = true;
    bench.finish(LONG)?;
    let summary = bench.summary();
    check(&bench, &summary)?;
    assert_eq!((summary.lines.lost, summary.lines.rejected), (0, 0));
    Ok(())
}

/// The emulator gets no time for longer than any watchdog waits; its clocks then jump.
#[test]
#[ignore = "cargo xtask hil"]
fn an_emulator_that_gets_no_time_resets_nothing() -> Result<()> {
    let mut bench = bench(Scene { sweeps: 2, ..SCENE }, Faults::default())?;
    bench.until("half of a sweep", LONG, |b| b.feeder.lines > 24)?;
    bench.emulator.freeze()?;
    bench.for_a_while(Duration::from_secs(10))?;
    bench.emulator.thaw()?;
    bench.finish(LONG)?;
    let summary = bench.summary();
    check(&bench, &summary)?;
    assert_eq!(summary.restarts, 0);
    assert_eq!(summary.counters["sweeps"], 2);
    Ok(())
}

#[test]
#[ignore = "cargo xtask hil"]
fn bytes_that_find_the_queue_full_are_counted() -> Result<()> {
    let mut bench = bench(Scene { sweeps: 2, ..SCENE }, Faults::default())?;
    bench.until("one sweep", LONG, |b| b.feeder.sweeps == 1)?;
    // a module that is busy for four seconds, and a sender that does not care; frames
    // are left out of it, as nobody could tell which of them came through
    bench.feeder.is_muted = true;
    bench.listener.request(configure(self_test::STALL, 4.0));
    bench.until("the answer", LONG, |b| !b.listener.acks.is_empty())?;
    for _ in 0..20 {
        bench.inject(&[0; 512]);
        bench.until("some bytes on their way", LONG, Bench::is_quiet)?;
    }
    let dropped = |b: &Bench<_>| b.listener.counter(counter::LINK_OVERRUN) > 0;
    bench.until("the count", LONG, dropped)?;
    bench.feeder.is_muted = false;
    bench.finish(LONG)?;
    let summary = bench.summary();
    check(&bench, &summary)?;
    assert!(summary.counters["link.overrun"] > 2_000, "{summary:#?}");
    assert_eq!(summary.counters["sweeps"], 2, "it has recovered");
    Ok(())
}

#[test]
#[ignore = "cargo xtask hil"]
fn a_panic_and_a_hang_are_counted_and_end_in_a_clean_session() -> Result<()> {
    let mut bench = bench(Scene { sweeps: 1, ..SCENE }, Faults::default())?;
    for (parameter, name) in [(self_test::PANIC, "panic"), (self_test::HANG, "watchdog")] {
        bench.listener.request(configure(parameter, 1.0));
        bench.reconnect(name, LONG)?;
    }
    bench.until("a status", LONG, |b| {
        b.listener.counter(counter::RESTARTS) == 2
    })?;
    assert_eq!(bench.listener.counter(counter::PANICS), 1);
    assert_eq!(bench.listener.counter(counter::WATCHDOGS), 1);
    let panic = bench
        .entries
        .iter()
        .find(|e| e.text.starts_with("panic at"));
    let place = panic.map(|e| e.text.clone()).unwrap_or_default();
    assert!(place.contains("module.rs"), "{:#?}", bench.entries);
    Ok(())
}

#[test]
#[ignore = "cargo xtask hil"]
fn parameters_are_checked_and_self_tests_answered() -> Result<()> {
    let mut bench = bench(Scene { sweeps: 1, ..SCENE }, Faults::default())?;
    for (parameter, value) in [(2, 4.0), (2, f32::NAN), (0, 0.2), (99, 1.0)] {
        bench.listener.request(configure(parameter, value));
    }
    bench
        .listener
        .request(Message::Echo([1, 0, 2, 0, 0].into_iter().collect()));
    bench.listener.request(Message::Source { count: 500 });
    bench.until("500 sinks", LONG, |b| b.listener.sinks == 500)?;
    let verdicts: Vec<_> = bench.listener.acks.iter().map(|ack| ack.verdict).collect();
    use Verdict::{Accepted, OutOfRange, UnknownParameter, Unsupported};
    assert_eq!(
        verdicts,
        [Accepted, OutOfRange, Unsupported, UnknownParameter]
    );
    assert_eq!(bench.listener.echoes, [[1, 0, 2, 0, 0]]);
    bench.until("counters", LONG, |b| {
        b.listener.counter(counter::CONFIGURE_REFUSED) == 3
    })?;
    assert_eq!(bench.listener.counter(counter::CONFIGURE_ACCEPTED), 1);
    Ok(())
}

fn configure(parameter: u8, value: f32) -> Message {
    Message::Configure(Configure { parameter, value })
}

#[test]
#[ignore = "cargo xtask hil"]
fn the_numerics_on_the_target_have_the_fingerprints_of_the_host() -> Result<()> {
    let image = image("numerics")?;
    let mut log = Log::of(&image)?;
    let mut emulator = Emulator::start(EmulatorSettings {
        image,
        instructions_ns: Some(3),
        ..EmulatorSettings::default()
    })?;
    let exit = emulator.wait(LONG)?;
    emulator.kill()?;
    let entries = log.take(&emulator.take_log().0);
    assert_eq!(exit, Exit::Code(0), "{entries:#?}");
    let passed = |name: &str| entries.iter().any(|entry| entry.text.starts_with(name));
    for check in CHECKS {
        assert!(passed(check.name), "{}: {entries:#?}", check.name);
    }
    Ok(())
}
