//! A planner on rugosa's costs: loads a saved map, finds the cheapest way with A* and draws
//! it on the map.
//!
//! ```sh
//! rugosa demo --out out/demo
//! cargo run --example plan -- out/demo/map.rugosa plan.png            # to the farthest place
//! cargo run --example plan -- out/demo/map.rugosa plan.png -1,0 2,1.5 # from, to [m]
//! ```

use rugosa_host::bridge::{draw_way, known_part};
use rugosa_host::config::Settings;
use rugosa_host::error::{Failure, Result};
use rugosa_host::plan::Planner;
use rugosa_host::planes::HeapPlanes;
use rugosa_host::saved::{self, SavedMap};
use std::path::Path;
use std::process::ExitCode;

/// Radius of the robot \[m\].
const RADIUS: f32 = 0.25;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("plan: {failure}");
            failure.exit_code()
        }
    }
}

fn run(arguments: &[String]) -> Result<()> {
    let usage = || Failure::input("usage: plan MAP.rugosa PICTURE.png [X,Y X,Y]");
    let [map, picture, ends @ ..] = arguments else {
        return Err(usage());
    };
    let map = SavedMap::read(Path::new(map))?;
    let settings = map.fit(Settings::default())?;
    let mut planes = HeapPlanes::new(settings.side);
    let (mapper, _, layers) = saved::load(&map, &settings, &mut planes)?;
    let mut planner = Planner::new(&mapper, RADIUS);
    let none = || Failure::runtime("nowhere to stand");
    let (from, to) = match ends {
        [] => {
            let centre = mapper.window().centre();
            let (x, y) = mapper.lattice().centre(centre);
            let from = planner.nearest([x, y]).ok_or_else(none)?;
            (from, planner.farthest(from).ok_or_else(none)?)
        }
        [from, to] => {
            let [from, to] = [from, to].map(|text| point(text, layers.shift));
            (from.ok_or_else(usage)?, to.ok_or_else(usage)?)
        }
        _ => return Err(usage()),
    };
    let plan = planner
        .plan(from, to)
        .ok_or_else(|| Failure::runtime("there is no way"))?;
    println!(
        "{:.2} m in {} cells, worst cost {:.2} ({:?})",
        plan.length,
        plan.cells.len(),
        plan.worst.0,
        plan.worst.1
    );
    draw_way(&known_part(&layers), &plan.points)?.save(Path::new(picture))
}

/// A point on the command line, in the mapper's coordinates.
fn point(text: &str, shift: [f64; 2]) -> Option<[f32; 2]> {
    let (x, y) = text.split_once(',')?;
    let [x, y]: [f64; 2] = [x.trim().parse().ok()?, y.trim().parse().ok()?];
    Some([(x - shift[0]) as f32, (y - shift[1]) as f32])
}
