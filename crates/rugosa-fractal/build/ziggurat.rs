//! Edges of the ziggurat's layers: see src/synthesis/normal.rs.

const LAYERS: usize = 128;

fn density(x: f64) -> f64 {
    libm::exp(-0.5 * x * x)
}

/// Area of the lowest layer when it ends at `r`: the rectangle and the tail.
fn area(r: f64) -> f64 {
    let tail = libm::sqrt(std::f64::consts::FRAC_PI_2) * libm::erfc(r / std::f64::consts::SQRT_2);
    r * density(r) + tail
}

/// Edges from the last edge `r` inwards, and by how much the stack of layers of equal
/// area overshoots f(0) = 1.
fn stack(r: f64) -> (f64, Vec<f64>) {
    let v = area(r);
    let mut edges = vec![v / density(r), r];
    let mut height = density(r);
    loop {
        height += v / edges[edges.len() - 1];
        if edges.len() == LAYERS || height >= 1.0 {
            break;
        }
        edges.push(libm::sqrt(-2.0 * libm::log(height)));
    }
    let missing = (LAYERS - edges.len()) as f64;
    edges.resize(LAYERS + 1, 0.0);
    (height - 1.0 + missing, edges)
}

/// The table as Rust source.
pub fn table() -> String {
    let (mut low, mut high) = (3.0, 4.0);
    for _ in 0..80 {
        let r = 0.5 * (low + high);
        if stack(r).0 > 0.0 { low = r } else { high = r }
    }
    let edges: Vec<f32> = stack(high).1.iter().map(|&x| x as f32).collect();
    format!(
        "/// Edges x_0 … x_128 of the layers.\nstatic EDGE: [f32; {}] = {edges:?};\n",
        edges.len()
    )
}
