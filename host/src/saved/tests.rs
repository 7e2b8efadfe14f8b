use super::*;
use nalgebra::Isometry3;
use rugosa_terrain::Noise;
use rugosa_terrain::grid::View;

/// A map of bumps, seen by a robot at (x, y), with noise of its own; the far side is not
/// seen and one ghost has been cleared.
fn mapped(seed: u64, [x, y]: [f32; 2], see: impl FnOnce(&Mapper, &SavedMap)) {
    let settings = Settings {
        side: 65,
        ..Settings::default()
    };
    let mut planes = HeapPlanes::new(65);
    let mut mapper = Mapper::new(settings.mapper, planes.lend()).unwrap();
    mapper.follow(&Isometry3::translation(x, y, 30.0));
    let mut state = seed;
    let mut uniform = move || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let points: Vec<[f32; 3]> = (0..6000)
        .map(|_| {
            let (east, north) = (6.0 * uniform() - 3.0, 4.0 * uniform() - 3.0);
            let (px, py) = (x + east, y + north);
            let z = 30.0 + (1.3 * px).sin() * (0.7 * py).cos() + 0.1 * uniform();
            [east, north, z - 35.0]
        })
        .collect();
    let view = View {
        map_from_sensor: &Isometry3::translation(x, y, 35.0),
        noise: &Noise::new(0.02, 0.001, 0.0005),
        sweep: 7,
    };
    mapper.points(&points, &view);
    mapper.commit(&mut |_| {});
    let saved = SavedMap::of(&mapper);
    see(&mapper, &saved);
}

fn map(seed: u64, at: [f32; 2]) -> SavedMap {
    let mut copy = None;
    mapped(seed, at, |_, saved| copy = Some(saved.clone()));
    copy.unwrap()
}

fn bytes(map: &SavedMap) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.rugosa");
    map.write(&path).unwrap();
    assert_eq!(&SavedMap::read(&path).unwrap(), map);
    std::fs::read(path).unwrap()
}

fn layers(map: &SavedMap) -> Layers {
    let settings = map.fit(Settings::default()).unwrap();
    let mut planes = HeapPlanes::new(settings.side);
    load(map, &settings, &mut planes).unwrap().2
}

/// Names and bits of all layers but those of the reconstruction, which starts afresh.
fn bits(layers: &Layers) -> Vec<(String, Vec<u32>)> {
    let fresh = ["mean", "inferred"];
    let kept = layers
        .layers
        .iter()
        .filter(|l| !fresh.contains(&l.name.as_str()));
    kept.map(|l| {
        (
            l.name.clone(),
            l.values.iter().map(|v| v.to_bits()).collect(),
        )
    })
    .collect()
}

#[test]
fn a_moved_map_is_loaded_bit_for_bit() {
    mapped(1, [17.3, -41.2], |mapper, saved| {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.rugosa");
        saved.write(&path).unwrap();
        let back = SavedMap::read(&path).unwrap();
        assert_eq!(&back, saved);
        assert!(back.measured() > 1000);
        let (before, after) = (layers_of(mapper), layers(&back));
        assert_eq!((before.corner, before.rows), (after.corner, after.rows));
        let (before, after) = (bits(&before), bits(&after));
        assert!(before.len() > 20, "{} layers", before.len());
        for (a, b) in before.iter().zip(&after) {
            assert!(a == b, "layer {} differs", a.0);
        }
    });
}

#[test]
fn any_order_and_any_grouping_give_the_same_bytes() {
    let [a, b, c] = [(1, [0.0, 0.0]), (2, [2.1, -3.4]), (3, [-1.7, 4.9])].map(|(s, p)| map(s, p));
    let join = |x: &SavedMap, y: &SavedMap| x.merged(y).unwrap();
    let expected = bytes(&join(&join(&a, &b), &c));
    for other in [
        join(&a, &join(&b, &c)),
        join(&join(&c, &a), &b),
        join(&b, &join(&c, &a)),
        join(&join(&c, &b), &a),
    ] {
        assert!(bytes(&other) == expected);
    }
}

/// Against sums in f64, where two maps measured a cell.
#[test]
fn variances_weigh_the_elevations() {
    let [a, b] = [map(1, [0.0, 0.0]), map(2, [2.1, -3.4])];
    let both = a.merged(&b).unwrap();
    let find = |map: &SavedMap, cell: [i64; 2]| {
        let [x, y] = [0, 1].map(|i| cell[i] - map.cell[i]);
        let inside = x >= 0 && y >= 0 && x < map.columns as i64 && y < map.rows as i64;
        let cell = inside.then(|| map.cells[y as usize * map.columns + x as usize]);
        cell.filter(|c| c.state == State::Measured)
    };
    let mut overlap = 0;
    for i in 0..both.cells.len() {
        let cell = [
            both.cell[0] + (i % both.columns) as i64,
            both.cell[1] + (i / both.columns) as i64,
        ];
        let (found, of_a, of_b) = (find(&both, cell), find(&a, cell), find(&b, cell));
        assert_eq!(found.is_some(), of_a.is_some() || of_b.is_some());
        let (Some(found), Some(p), Some(q)) = (found, of_a, of_b) else {
            continue;
        };
        overlap += 1;
        let weight = |c: &SavedCell| 1.0 / f64::from(c.variance);
        let sum = weight(&p) + weight(&q);
        let z = |c: &SavedCell| f64::from(c.elevation) * weight(c) / sum;
        assert!((f64::from(found.elevation) - z(&p) - z(&q)).abs() < 1e-5);
        assert!((f64::from(found.variance) * sum - 1.0).abs() < 1e-4);
        assert_eq!(found.tally, p.tally + q.tally);
        assert_eq!((found.min, found.max), (p.min.min(q.min), p.max.max(q.max)));
    }
    assert!(overlap > 150, "{overlap} cells in both");
}

#[test]
fn a_part_is_the_same_cells() {
    let whole = map(1, [17.3, -41.2]);
    let [x, y] = whole.corner();
    let part = whole.crop([x + 1.0, y + 2.0, x + 3.0, y + 2.5]).unwrap();
    assert_eq!((part.rows, part.columns), (5, 20));
    assert!((part.corner()[0] - x - 1.0).abs() < 1e-9);
    assert_eq!(part.cells[21], whole.cells[21 * 65 + 11]);
    let (whole, part) = (layers(&whole), layers(&part));
    let row = |l: &Layers, i: usize| l.get("elevation").unwrap().values[i..][..20].to_vec();
    let same = |a: f32, b: f32| a.to_bits() == b.to_bits();
    let pairs = row(&part, 0).into_iter().zip(row(&whole, 20 * 65 + 10));
    assert!(pairs.into_iter().all(|(a, b)| same(a, b)));
    assert!(map(1, [0.0, 0.0]).crop([99.0, 0.0, 100.0, 1.0]).is_err());
}

#[test]
fn maps_that_do_not_fit_are_refused() {
    let a = map(1, [0.0, 0.0]);
    let refuse = |b: SavedMap, expected: &str| {
        let error = a.merged(&b).unwrap_err();
        assert!(error.message.contains(expected), "{error}");
    };
    let clone = || a.clone();
    refuse(
        SavedMap {
            resolution: 0.2,
            ..clone()
        },
        "resolution of 0.1 and 0.2",
    );
    refuse(
        SavedMap {
            height_step: 0.1,
            ..clone()
        },
        "height_step",
    );
    refuse(
        SavedMap {
            shift: [0.03, 0.0],
            ..clone()
        },
        "beside each other",
    );
    refuse(
        SavedMap {
            shift: [200.0, 0.0],
            ..clone()
        },
        "2065 × 65 cells",
    );
}

#[test]
fn files_that_are_no_maps_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.rugosa");
    let good = bytes(&map(1, [0.0, 0.0]));
    for length in [0, 100, good.len() / 2, good.len() - 1] {
        std::fs::write(&path, &good[..length]).unwrap();
        let error = SavedMap::read(&path).unwrap_err();
        assert!(error.message.contains("a.rugosa"), "{error}");
    }
    let write = |map: &SavedMap| map.write(&path).unwrap();
    write(&SavedMap {
        resolution: -1.0,
        ..map(1, [0.0; 2])
    });
    assert!(
        SavedMap::read(&path)
            .unwrap_err()
            .message
            .contains("positive")
    );
    let mut absurd = map(1, [0.0; 2]);
    absurd.cells.iter_mut().for_each(|c| c.variance = f32::NAN);
    write(&absurd);
    assert!(
        SavedMap::read(&path)
            .unwrap_err()
            .message
            .contains("cannot be")
    );
}
