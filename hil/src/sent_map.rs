//! The map as a module has sent it, patch by patch.

use rugosa::{LAYERS, Layer, outbox::value_of};
use rugosa_grid::{Cell, Tile};
use rugosa_wire::Patch;
use std::collections::HashMap;

/// A value of the map as it was sent: what it is, and how coarse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sent {
    /// NaN where the module knows nothing
    pub value: f32,
    /// it lies within this of the module's own value
    pub within: f32,
}

/// A rectangle of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// the cell with the least x and y
    pub origin: Cell,
    /// cells along x
    pub columns: usize,
    /// cells along y
    pub rows: usize,
}

/// All values that were sent, the last one of each cell.
#[derive(Clone, Debug, Default)]
pub struct SentMap {
    values: HashMap<(u8, Cell), Sent>,
    patches: u32,
}

impl SentMap {
    /// Takes a patch.
    pub fn place(&mut self, patch: &Patch) {
        self.patches += 1;
        let (width, stride) = (i32::from(patch.width.max(1)), i32::from(patch.stride));
        for (i, &number) in patch.values.iter().enumerate() {
            let (column, row) = (i as i32 % width, i as i32 / width);
            let cell = Cell::new(patch.x + column * stride, patch.y + row * stride);
            let sent = Sent {
                value: value_of(patch, number),
                within: 0.51 * patch.scale + 1e-6 * patch.offset.abs(),
            };
            self.values.insert((patch.layer, cell), sent);
        }
    }

    /// Patches taken.
    pub fn patches(&self) -> u32 {
        self.patches
    }

    /// A value as it was sent; layers by tile have one for the tile's first cell.
    pub fn value(&self, layer: Layer, cell: Cell) -> Option<Sent> {
        self.values.get(&(layer as u8, cell)).copied()
    }

    /// The cells with a known value; `None`: there are none.
    pub fn extent(&self) -> Option<Extent> {
        let known = self.values.iter().filter(|(_, sent)| !sent.value.is_nan());
        let bounds = known.fold(None, |bounds: Option<[i32; 4]>, ((_, cell), _)| {
            let [a, b, c, d] = bounds.unwrap_or([cell.x, cell.x, cell.y, cell.y]);
            Some([a.min(cell.x), b.max(cell.x), c.min(cell.y), d.max(cell.y)])
        });
        bounds.map(|[left, right, bottom, top]| Extent {
            origin: Cell::new(left, bottom),
            columns: (right - left + 1) as usize,
            rows: (top - bottom + 1) as usize,
        })
    }

    /// The layers that hold anything, over these cells: name, unit and values, row = y
    /// ascending, NaN unknown.
    pub fn layers(&self, extent: &Extent) -> Vec<(&'static str, &'static str, Vec<f32>)> {
        let all = LAYERS
            .iter()
            .map(|d| (d.name, d.unit, self.layer(d.layer, extent)));
        all.filter(|(.., values)| values.iter().any(|v| !v.is_nan()))
            .collect()
    }

    fn layer(&self, layer: Layer, extent: &Extent) -> Vec<f32> {
        let cells = (0..extent.rows * extent.columns).map(|i| {
            let (x, y) = (i % extent.columns, i / extent.columns);
            extent.origin.offset(x as i32, y as i32)
        });
        cells
            .map(|cell| self.value(layer, place_of(layer, cell)))
            .map(|sent| sent.map_or(f32::NAN, |sent| sent.value))
            .collect()
    }
}

/// Where the value of a cell is kept: layers by tile have one for all of its cells.
fn place_of(layer: Layer, cell: Cell) -> Cell {
    if layer.description().per_tile {
        Tile::of(cell).origin()
    } else {
        cell
    }
}
