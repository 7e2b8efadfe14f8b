//! The elevation as a triangle mesh in binary PLY: a vertex per known cell, two
//! triangles between four known neighbours.

use crate::error::{Failure, Result};
use crate::io::{Raster, atomic};
use crate::layers::Layers;
use std::io::{self, Write};
use std::path::Path;

/// Writes the surface: the reconstruction's mean where there is one, else the elevation.
pub fn write(path: &Path, layers: &Layers) -> Result<()> {
    let layer = layers.get("mean").or_else(|| layers.get("elevation"));
    let layer = layer.ok_or_else(|| Failure::input("a mesh needs an elevation layer"))?;
    let raster = layers.raster(layer);
    atomic::write(path, |writer| encode(writer, &raster))
}

/// Encodes a raster.
pub fn encode(writer: &mut dyn Write, raster: &Raster) -> io::Result<()> {
    let vertices = raster.points();
    let triangles = triangles(raster);
    write!(
        writer,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        triangles.len()
    )?;
    for coordinate in vertices.iter().flatten() {
        writer.write_all(&(*coordinate as f32).to_le_bytes())?;
    }
    for triangle in &triangles {
        writer.write_all(&[3])?;
        for index in triangle {
            writer.write_all(&index.to_le_bytes())?;
        }
    }
    Ok(())
}

/// Counter-clockwise seen from above, so that normals point up.
fn triangles(raster: &Raster) -> Vec<[i32; 3]> {
    let mut next = 0;
    let number = |v: &f32| {
        v.is_finite().then(|| {
            next += 1;
            next - 1
        })
    };
    let numbers: Vec<Option<i32>> = raster.values.iter().map(number).collect();
    let mut triangles = Vec::new();
    for row in 0..raster.rows - 1 {
        for column in 0..raster.columns - 1 {
            let corner = |i: usize, j: usize| numbers[(row + i) * raster.columns + column + j];
            let square = (corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0));
            if let (Some(a), Some(b), Some(c), Some(d)) = square {
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::ply;

    #[test]
    fn the_vertices_are_read_back_and_holes_have_no_triangles() {
        let mut values: Vec<f32> = (0..9).map(|v| v as f32).collect();
        values[8] = f32::NAN;
        let raster = Raster::square(3, 3, 0.5, [1.0, 2.0], values);
        assert_eq!(triangles(&raster).len(), 6);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.ply");
        write(&path, &Layers::of_raster(&raster).unwrap()).unwrap();
        let back = ply::read(&path).unwrap();
        assert_eq!(back.xyz.len(), 8);
        assert_eq!(back.xyz[5], [2.0, 2.5, 5.0]);
    }

    #[test]
    fn normals_point_up() {
        let raster = Raster::square(2, 2, 1.0, [0.0, 0.0], vec![0.0; 4]);
        let points = raster.points();
        for [a, b, c] in triangles(&raster) {
            let [a, b, c] = [a, b, c].map(|i| points[i as usize]);
            let z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(z > 0.0);
        }
    }
}
