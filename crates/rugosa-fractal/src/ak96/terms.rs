//! The quadratic terms of the prior energy in which one node takes part.
//!
//! Membrane: (v − v_neighbour)², 4 terms. Thin plate: v_xx² and v_yy² over three nodes in
//! a line, 3 terms each by the node's place in the line; 2 v_xy² over the four nodes of a
//! square, 4 terms. Terms that reach beyond the border are left out (free border).

/// One term: weight · (own · v + Σ coefficient · v_other)².
struct Term {
    membrane: f32,
    plate: f32,
    own: f32,
    /// row and column offset, coefficient
    others: [(i8, i8, f32); 3],
}

const NONE: (i8, i8, f32) = (0, 0, 0.0);

const fn membrane(y: i8, x: i8) -> Term {
    Term {
        membrane: 1.0,
        plate: 0.0,
        own: 1.0,
        others: [(y, x, -1.0), NONE, NONE],
    }
}

/// A node at the end of a line of three that runs in direction (y, x).
const fn line_end(y: i8, x: i8) -> Term {
    Term {
        membrane: 0.0,
        plate: 1.0,
        own: 1.0,
        others: [(y, x, -2.0), (2 * y, 2 * x, 1.0), NONE],
    }
}

/// A node in the middle of a line of three.
const fn line_middle(y: i8, x: i8) -> Term {
    Term {
        membrane: 0.0,
        plate: 1.0,
        own: -2.0,
        others: [(y, x, 1.0), (-y, -x, 1.0), NONE],
    }
}

/// A node at a corner of a square whose opposite corner is (y, x).
const fn square(y: i8, x: i8) -> Term {
    Term {
        membrane: 0.0,
        plate: 2.0,
        own: 1.0,
        others: [(y, 0, -1.0), (0, x, -1.0), (y, x, 1.0)],
    }
}

static TERMS: [Term; 14] = [
    membrane(0, 1),
    membrane(0, -1),
    membrane(1, 0),
    membrane(-1, 0),
    line_end(0, 1),
    line_end(0, -1),
    line_end(1, 0),
    line_end(-1, 0),
    line_middle(0, 1),
    line_middle(1, 0),
    square(1, 1),
    square(1, -1),
    square(-1, 1),
    square(-1, -1),
];

/// Curvature of the prior energy at a node and its pull towards the neighbours.
pub(super) fn pull(
    layer: &[f32],
    n: usize,
    (row, column): (usize, usize),
    (membrane, plate): (f32, f32),
) -> (f32, f32) {
    let at = |y: i8, x: i8| -> Option<f32> {
        let (y, x) = (
            row.checked_add_signed(y.into())?,
            column.checked_add_signed(x.into())?,
        );
        (y < n && x < n).then(|| layer[y * n + x])
    };
    let (mut a, mut b) = (0.0, 0.0);
    for term in &TERMS {
        let others = term
            .others
            .iter()
            .try_fold(0.0, |sum, &(y, x, coefficient)| {
                Some(sum + coefficient * at(y, x)?)
            });
        if let Some(others) = others {
            let weight = membrane * term.membrane + plate * term.plate;
            a += weight * term.own * term.own;
            b -= weight * term.own * others;
        }
    }
    (a, b)
}
