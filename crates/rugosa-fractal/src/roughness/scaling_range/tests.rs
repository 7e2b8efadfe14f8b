extern crate std;
use super::*;
use std::string::String;
use std::vec::Vec;

struct Case {
    value: serde_json::Value,
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Case {
    fn number(&self, key: &str) -> usize {
        self.value[key].as_u64().unwrap() as usize
    }
}

fn cases() -> Vec<Case> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/oracles/scaleless.json"
    );
    let text: String = std::fs::read_to_string(path).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let case = |value: &serde_json::Value| {
        let y: Vec<f64> = value["y"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap())
            .collect();
        let x = (1..=y.len()).map(|i| (i as f64).ln()).collect();
        Case {
            value: value.clone(),
            x,
            y,
        }
    };
    json["cases"].as_array().unwrap().iter().map(case).collect()
}

#[test]
fn sixteen_curves_agree_with_the_reference() {
    let cases = cases();
    assert_eq!(cases.len(), 16);
    for case in &cases {
        let (x, y) = (&case.x[..], &case.y[..]);
        let f = fang(x, y, false);
        assert_eq!(f.points, case.number("fang_literal"));
        let expected = case.value["fang_per_m"].as_array().unwrap();
        assert!(
            f.by_order
                .iter()
                .zip(expected)
                .all(|(&k, e)| k as u64 == e.as_u64().unwrap())
        );
        let exact_line = case.value["noise"].as_f64() == Some(0.0) && case.value["kind"] != "exp";
        if !exact_line {
            // on an exact line the reference's elongations differ by rounding only
            assert_eq!(
                elongation::first_maximum(x, y),
                case.number("yokoya_first_max")
            );
        }
        let r = robust(x, y, 0.02);
        assert_eq!(
            (r.points, r.degree),
            (case.number("robust"), case.number("robust_m"))
        );
        let line = scaling_range(x, y, Method::default()).unwrap();
        assert!((line.slope - case.value["robust_H"].as_f64().unwrap()).abs() < 1e-12);
        assert_eq!(line.points(), r.points);
    }
}

/// Slope 0.8 up to point 13 of 40, then 0.2.
fn broken() -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (1..=40).map(|i| f64::from(i).ln()).collect();
    let knee = 13f64.ln();
    let y = x
        .iter()
        .map(|&x| 0.8 * x.min(knee) + 0.2 * (x - knee).max(0.0))
        .collect();
    (x, y)
}

#[test]
fn a_break_at_point_13_is_found_by_all_but_elongation() {
    let (x, y) = broken();
    for method in [
        Method::LeastSquares { tolerance: 1e-9 },
        Method::Fang { guarded: false },
        Method::Fang { guarded: true },
        Method::Robust { tolerance: 0.02 },
    ] {
        let range = scaling_range(&x, &y, method).unwrap();
        if let Method::LeastSquares { .. } = method {
            assert_eq!((range.first, range.last), (12, 39));
            assert!((range.slope - 0.2).abs() < 1e-9);
        } else {
            assert_eq!((range.first, range.last), (0, 12), "{method:?}");
            assert!((range.slope - 0.8).abs() < 1e-9);
        }
    }
}

#[test]
fn a_polyline_reports_both_segments() {
    let (x, y) = broken();
    let segments = polyline(&x, &y, 1e-6);
    assert_eq!(segments.ends(), &[(0, 12), (12, 39)]);
    let slopes: Vec<f64> = segments.lines(&x, &y).map(|line| line.slope).collect();
    assert!((slopes[0] - 0.8).abs() < 1e-9 && (slopes[1] - 0.2).abs() < 1e-9);
    let range = scaling_range(&x, &y, Method::Polyline { tolerance: 1e-6 }).unwrap();
    assert_eq!((range.first, range.last), (12, 39));
}

#[test]
fn saturation_is_a_matter_of_tolerance() {
    let cases = cases();
    let case = cases
        .iter()
        .find(|c| c.value["kind"] == "exp" && c.value["noise"].as_f64() == Some(0.0))
        .unwrap();
    assert_eq!(robust(&case.x, &case.y, 0.02).points, 6);
    assert_eq!(robust(&case.x, &case.y, 0.04).points, 13);
}

#[test]
fn no_line_is_said_to_be_none() {
    let x: Vec<f64> = (1..=20).map(|i| f64::from(i).ln()).collect();
    let flat = std::vec![1.0; 20];
    assert!(matches!(
        scaling_range(&x, &flat, Method::Whole),
        Err(NoRange::Slope(_))
    ));
    let steep: Vec<f64> = x.iter().map(|x| 1.3 * x).collect();
    assert!(matches!(
        scaling_range(&x, &steep, Method::default()),
        Err(NoRange::Slope(_))
    ));
    assert_eq!(
        scaling_range(&x[..2], &flat, Method::default()),
        Err(NoRange::TooFewPoints)
    );
    let zigzag: Vec<f64> = (0..20).map(|i| f64::from(i % 2)).collect();
    assert_eq!(
        scaling_range(&x, &zigzag, Method::LeastSquares { tolerance: 0.02 }),
        Err(NoRange::NoLine)
    );
}

#[test]
fn fewer_than_seven_points_are_all_taken() {
    let x: Vec<f64> = (1..=6).map(|i| f64::from(i).ln()).collect();
    let y: Vec<f64> = x.iter().map(|x| 0.5 * x.min(1.0)).collect();
    assert_eq!(robust(&x, &y, 0.02).points, 6);
}
