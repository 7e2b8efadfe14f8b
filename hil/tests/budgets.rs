//! Flash, RAM, stack and instructions of the firmware stay within `firmware/budgets.json`.
//!
//! `RUGOSA_BLESS=1` writes the measured instructions instead of comparing; the limits of
//! memory are decisions and are edited by hand.

use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSection, SectionFlags, SectionKind};
use rugosa_hil::costs::{SweepCost, frames, of_solver, on_host, on_target};
use rugosa_hil::{Scene, image};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

const TOLERANCE: f64 = 0.03;

/// The published scanner: 256 × 256, two images a second, in front of a walking robot.
const SCENE: Scene = Scene {
    lines: 256,
    columns: 256,
    sweeps: 4,
    speed: 0.3,
    seed: 3,
};

fn budgets_file() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../firmware/budgets.json")
}

fn budgets() -> Result<Value> {
    let text = std::fs::read_to_string(budgets_file()).context("firmware/budgets.json")?;
    Ok(serde_json::from_str(&text)?)
}

#[test]
#[ignore = "cargo xtask hil"]
fn flash_and_static_ram_stay_within_the_budget() -> Result<()> {
    let budget = &budgets()?["mps2-an386"];
    let elf = std::fs::read(image("mps2-an386")?)?;
    let file = object::File::parse(&*elf)?;
    let (mut flash, mut ram) = (0, 0);
    for section in file.sections().filter(is_loaded) {
        let in_ram = section.address() >= 0x2000_0000;
        let is_stored = section.kind() != SectionKind::UninitializedData;
        ram += if in_ram { section.size() } else { 0 };
        flash += if is_stored { section.size() } else { 0 };
    }
    eprintln!("flash {flash} bytes, static RAM {ram} bytes");
    ensure!(flash > 10_000 && ram > 10_000, "the image is read wrongly");
    ensure!(
        Some(flash) <= budget["flash"].as_u64(),
        "flash: {flash} bytes"
    );
    ensure!(
        Some(ram) <= budget["static_ram"].as_u64(),
        "static RAM: {ram} bytes"
    );
    Ok(())
}

fn is_loaded(section: &object::Section) -> bool {
    const ALLOCATED: u64 = 2; // SHF_ALLOC
    let SectionFlags::Elf { sh_flags } = section.flags() else {
        return false;
    };
    sh_flags & ALLOCATED != 0
}

#[test]
#[ignore = "cargo xtask hil"]
fn stages_cost_no_more_than_they_did_and_map_the_same() -> Result<()> {
    let (description, messages) = SCENE.messages()?;
    let frames = frames(description.into_iter().chain(messages));
    let sweeps = on_target(&image("costs")?, &frames)?;
    let digests: Vec<u32> = sweeps.iter().map(|sweep| sweep.digest).collect();
    assert_eq!(digests, on_host(&frames), "target and host map differently");
    assert_eq!(sweeps.len() as u32, SCENE.sweeps);

    let mut measured = measured(&sweeps);
    measured.extend(of_the_solver()?);
    eprintln!("{}", serde_json::to_string_pretty(&measured)?);
    let mut budgets = budgets()?;
    if std::env::var_os("RUGOSA_BLESS").is_some() {
        budgets["instructions"] = Value::Object(measured);
        std::fs::write(
            budgets_file(),
            serde_json::to_string_pretty(&budgets)? + "\n",
        )?;
        return Ok(());
    }
    let stack = sweeps.iter().map(|sweep| sweep.stack).max();
    ensure!(
        stack.map(u64::from) <= budgets["mps2-an386"]["stack"].as_u64(),
        "stack: {stack:?}"
    );
    for (name, value) in &measured {
        let (now, before) = (value.as_f64(), budgets["instructions"][name].as_f64());
        let (now, before) = now
            .zip(before)
            .with_context(|| format!("{name} is not in the table"))?;
        ensure!(
            now <= before * (1.0 + TOLERANCE),
            "{name}: {now} instructions, {before} before"
        );
    }
    Ok(())
}

/// The parts of a reconstruction, and that ten iterations are enough.
fn of_the_solver() -> Result<Map<String, Value>> {
    let cost = of_solver(&image("solver")?)?;
    ensure!(cost.ppm < 1000, "residual after ten iterations: {cost:?}");
    let table = [
        ("reconstruction, taking the data in", cost.observe),
        ("reconstruction, one iteration", cost.iteration),
        ("reconstruction, the mean", cost.mean),
    ];
    let named = table.map(|(name, value)| (name.to_owned(), json!(value)));
    Ok(named.into_iter().collect())
}

/// Per return: the first sweep, when every pair is new, and the steady state, the last
/// one. Per sweep: the dearest of all, which refreshes every tile.
fn measured(sweeps: &[SweepCost]) -> Map<String, Value> {
    let (Some(first), [.., before, last]) = (sweeps.first(), sweeps) else {
        return Map::new();
    };
    let tenths = |cost: u32, returns: u32| {
        json!((f64::from(cost) / f64::from(returns) * 10.0).round() / 10.0)
    };
    let mut table = Map::new();
    for (name, sweep, returns) in [
        ("first sweep", first, first.returns),
        ("steady state", last, last.returns - before.returns),
    ] {
        let all = sweep.receive + sweep.lines + sweep.counters;
        for (part, cost) in [
            ("decoding", sweep.receive),
            ("projection and fusion", sweep.lines),
            ("pair counters", sweep.counters),
            ("all of these", all),
        ] {
            table.insert(format!("{name}: {part}, per return"), tenths(cost, returns));
        }
    }
    let dearest = |cost: fn(&SweepCost) -> u32| sweeps.iter().map(cost).max();
    for (name, cost) in [
        ("refresh of roughness, all tiles", dearest(|s| s.roughness)),
        (
            "estimate of the whole map and reconstruction, per sweep",
            dearest(|s| s.reconstruction),
        ),
        ("traversability, all tiles", dearest(|s| s.traversability)),
    ] {
        table.insert(name.into(), json!(cost));
    }
    table
}
