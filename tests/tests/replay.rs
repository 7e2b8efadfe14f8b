//! Recorded sweeps through a virtual serial port, at several chunkings, to the report
//! that is expected. `BLESS=1` writes the expected report anew.

use anyhow::Result;
use rugosa::{Config, Layer};
use rugosa_fractal::roughness::estimate;
use rugosa_host::recording::Recording;
use rugosa_tests::real_scan::RealScan;
use rugosa_tests::virtual_port::{Script, outcome};
use rugosa_wire::{Message, Role, counter};
use std::path::PathBuf;

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("recordings")
        .join(name)
}

/// A committed recording of the simulated scanner.
fn recorded(name: &str) -> Result<Script> {
    let (mut description, mut messages) = (vec![], vec![]);
    for entry in Recording::open(&file(name))? {
        let entry = entry?;
        match entry.frame.message {
            _ if entry.from != Role::Scanner => {}
            message @ (Message::Scanner(_) | Message::BeamTable(_)) => description.push(message),
            message @ (Message::Pose(_) | Message::Line(_) | Message::SweepEnd(_)) => {
                messages.push(message)
            }
            _ => {}
        }
    }
    Ok(Script {
        description,
        messages,
        side: 65,
        config: Config::default(),
    })
}

#[test]
fn recorded_sweeps_give_the_expected_report_at_every_chunking() -> Result<()> {
    let script = recorded("perceptron.mcap")?;
    let direct = script.map_directly(outcome)?;
    let expected = file("perceptron.json");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&expected, serde_json::to_string_pretty(&direct)? + "\n")?;
    }
    let expected: serde_json::Value = serde_json::from_slice(&std::fs::read(expected)?)?;
    assert_eq!(direct, expected);
    for most in [1 << 20, 1000, 61] {
        let mapped = script.map_through_port(most, outcome)?;
        assert_eq!(mapped, expected, "pieces of {most} bytes");
    }
    Ok(())
}

#[test]
fn the_recorded_ground_is_as_rough_as_the_simulator_made_it() -> Result<()> {
    let script = recorded("perceptron.mcap")?;
    let found = script.map_directly(|m| estimate(&m.pool(), &m.settings()))?;
    let found = found.map_err(|reason| anyhow::anyhow!("{reason:?}"))?;
    // the simulator's default ground: D = 2.3, sigma = 0.08 m
    let error = found.standard_error;
    assert!(
        error < 0.1 && (found.dimension - 2.3).abs() < 3.0 * error,
        "{found:?}"
    );
    // sigma is extrapolated from short lags: an error of D moves it by half of itself
    assert!((found.sigma / 0.08 - 1.0).abs() < 0.6, "{found:?}");
    Ok(())
}

/// A real scan of a forest floor: trunks and undergrowth beside a path.
#[test]
fn a_real_scan_goes_the_same_way() -> Result<()> {
    let Some(scan) = RealScan::read()? else {
        return Ok(());
    };
    let script = Script {
        description: scan.description(),
        messages: (1..4).flat_map(|number| scan.sweep(number)).collect(),
        side: 129,
        config: Config {
            sample: rugosa::config::SampleRule::Lowest,
            ..Config::default()
        },
    };
    let direct = script.map_directly(outcome)?;
    assert_eq!(direct["lines"]["used"], 3 * 512);
    assert_eq!(direct["lines"]["rejected"], 0);
    let look = |mapper: &rugosa::Mapper| {
        let get = |index| f64::from(mapper.counters().get(index));
        // 29.9 % of the beams found nothing
        let share = get(counter::RETURNS_NO_RETURN) / get(counter::RETURNS_RECEIVED);
        assert!((share - 0.299).abs() < 0.001, "{share}");
        assert!(get(counter::CELLS_MEASURED) > 4000.0);
        // the ground near the robot lies 0.5 m below the sensor, 0.1 m below the body
        let near = |cell: &rugosa_grid::Cell| {
            let (x, y) = mapper.lattice().centre(*cell);
            x.hypot(y) < 2.0
        };
        let cells = mapper.window().cells().filter(near);
        let elevations = cells.map(|cell| mapper.value(Layer::Elevation, cell));
        let mut elevations: Vec<f32> = elevations.filter(|z| z.is_finite()).collect();
        elevations.sort_by(f32::total_cmp);
        let median = elevations[elevations.len() / 2];
        assert!(
            (-0.25..0.1).contains(&median),
            "median elevation {median} m"
        );
        outcome(mapper)
    };
    assert_eq!(script.map_through_port(1 << 20, look)?, direct);
    let dimension = direct["dimension"].as_f64().expect("a dimension");
    assert!((2.3..2.95).contains(&dimension), "D = {dimension}");
    Ok(())
}
