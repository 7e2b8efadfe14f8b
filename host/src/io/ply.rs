//! PLY: the vertices of ASCII and binary files.

use super::{Points, open};
use crate::error::{Failure, Result};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult};
use std::path::Path;

/// One vertex; properties other than x, y, z are passed over.
struct Vertex([f64; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex([f64::NAN; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        let value = match property {
            Property::Double(v) => Some(v),
            other => other.to_f32_lossy().map(f64::from),
        };
        match value {
            Some(value) => {
                self.0[axis] = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

/// Reads the element `vertex`.
pub fn read(path: &Path) -> Result<Points> {
    let (file, length) = open(path)?;
    let parser = Parser::<Vertex>::new();
    let mut reader = Reader::new(file);
    let header = parser
        .read_header(&mut reader)
        .map_err(|e| Failure::file(path, e))?;
    for element in header.elements.values() {
        check(path, element, length)?;
    }
    let mut payload = parser
        .read_payload(&mut reader, &header)
        .map_err(|e| Failure::file(path, e))?;
    let vertices = payload.swap_remove("vertex").unwrap_or_default();
    Points::of(path, vertices.into_iter().map(|v| v.0).collect())
}

/// A vertex needs x, y, z; no element can have more entries than the file has bytes.
fn check(path: &Path, element: &ElementDef, length: u64) -> Result<()> {
    if element.count as u64 > length {
        let message = format_args!(
            "{} × '{}' in a file of {length} bytes",
            element.count, element.name
        );
        return Err(Failure::file(path, message));
    }
    let missing = ["x", "y", "z"]
        .into_iter()
        .find(|&p| !element.properties.contains_key(p));
    match missing {
        Some(name) if element.name == "vertex" => Err(Failure::file(
            path,
            format_args!("the vertices have no property {name}"),
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn read_bytes(content: &[u8]) -> Result<Points> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.ply");
        fs::write(&path, content).unwrap();
        read(&path)
    }

    const HEADER: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float z\nproperty uchar red\nproperty double x\nproperty int y\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn properties_in_any_order_and_faces_are_passed_over() {
        let points =
            read_bytes(format!("{HEADER}3 255 1 2\n6 0 4.5 5\n3 0 1 0\n").as_bytes()).unwrap();
        assert_eq!(points.xyz, [[1.0, 2.0, 3.0], [4.5, 5.0, 6.0]]);
    }

    #[test]
    fn binary_little_endian() {
        let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n".to_vec();
        for v in [1f32, -2.0, 3.5] {
            bytes.extend(v.to_le_bytes());
        }
        assert_eq!(read_bytes(&bytes).unwrap().xyz, [[1.0, -2.0, 3.5]]);
        bytes.pop();
        assert!(read_bytes(&bytes).unwrap_err().message.contains("a.ply"));
    }

    #[test]
    fn malformed_files_are_refused() {
        let absurd = HEADER.replace("vertex 2", "vertex 4000000000");
        assert!(
            read_bytes(absurd.as_bytes())
                .unwrap_err()
                .message
                .contains("4000000000")
        );
        let flat = HEADER.replace("float z", "float w");
        assert!(
            read_bytes(flat.as_bytes())
                .unwrap_err()
                .message
                .contains("no property z")
        );
        for content in [
            "",
            "ply\n",
            "solid stl\n",
            "ply\nformat ascii 1.0\nend_header\n",
        ] {
            assert!(read_bytes(content.as_bytes()).is_err(), "{content}");
        }
    }
}
