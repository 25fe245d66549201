//! Selections by hand, voxel by voxel, in a template.

use std::io::{Read as _, Write as _};
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fabrica_engine::selection::{BRICK, BRICK_VOXELS, Brick, BrickPool, BrickVoxels, Selection};
use fabrica_engine::spaces::Grid;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use glam::{DAffine3, DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Memberships of the voxels of a grid. Copies share their bricks, so that a figure's past holds what changed only.
///
/// In JSON: the grid's size, the first three rows of its voxel-to-world matrix (RAS mm), and gzipped bricks in base64, in
/// ascending order of z, y and x: place (three little-endian u32, in bricks of 8³ voxels), 0 and the membership of all of its
/// voxels, or 1 and 512 memberships, x fastest, 255 = 1.
#[derive(Clone, Debug)]
pub struct SelectionVoxels(Arc<Selection>);

/// Bricks along an edge of the blocks that copies share: what of an edit is copied at least.
const SHARED_BLOCK: usize = 8;

impl SelectionVoxels {
    /// Those of a selection.
    pub fn new(selection: Selection) -> Self {
        Self(Arc::new(selection))
    }

    /// As the engine has them.
    pub fn selection(&self) -> &Selection {
        &self.0
    }

    /// Bytes that are its own beside `other`: bricks, and the blocks in which they lie, that the two do not share.
    pub fn unshared_bytes(&self, other: &Self) -> usize {
        if self.0.grid().dims() != other.0.grid().dims() {
            return self.0.num_bytes();
        }
        let places = self.0.changed_since(&other.0);
        let voxels = places.iter().filter(|place| matches!(self.0.brick(**place), Brick::Voxels(_))).count();
        let mut blocks: Vec<[usize; 3]> = places.iter().map(|place| place.map(|n| n / SHARED_BLOCK)).collect();
        blocks.sort_unstable();
        blocks.dedup();
        let table = 8 * self.0.size_in_bricks().map(|n| n.div_ceil(SHARED_BLOCK)).iter().product::<usize>();
        table + voxels * size_of::<BrickVoxels>() + blocks.len() * SHARED_BLOCK.pow(3) * size_of::<Brick>()
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bricks: Vec<_> = self.0.bricks().collect();
        bricks.sort_by_key(|([x, y, z], _)| [*z, *y, *x]);
        let mut bytes = Vec::new();
        for (place, brick) in bricks {
            place.iter().for_each(|n| bytes.extend((*n as u32).to_le_bytes()));
            match brick {
                Brick::Uniform(value) => bytes.extend([0, *value]),
                Brick::Voxels(voxels) => {
                    bytes.push(1);
                    bytes.extend(voxels.values);
                }
            }
        }
        bytes
    }
}

/// The same voxels, whether shared or not.
impl PartialEq for SelectionVoxels {
    fn eq(&self, other: &Self) -> bool {
        let differs = |place: &[usize; 3]| self.0.brick(*place).values() != other.0.brick(*place).values();
        Arc::ptr_eq(&self.0, &other.0)
            || self.0.grid() == other.0.grid() && !self.0.changed_since(&other.0).iter().any(differs)
    }
}

/// What is written.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Written {
    /// Number of voxels along x, y, z.
    dims: [usize; 3],
    /// The first three rows of the matrix that takes a voxel's index to its middle in the world: RAS, mm.
    world_from_index: [[f64; 4]; 3],
    /// Bricks of 8³ voxels in which something is selected, in ascending order of z, y, x; gzipped and in base64. Each: its place in
    /// bricks (three little-endian 32-bit numbers), then 0 and one membership, or 1 and 512 of them, x fastest, 255 = 1.
    data: String,
}

impl Serialize for SelectionVoxels {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
        let data = gzip.write_all(&self.bytes()).and_then(|()| gzip.finish()).map_err(serde::ser::Error::custom)?;
        let affine = self.0.grid().world_from_index();
        let m = affine.matrix3.transpose().to_cols_array_2d();
        let t = affine.translation;
        let rows = std::array::from_fn(|i| [m[i][0], m[i][1], m[i][2], t[i]]);
        Written { dims: self.0.grid().dims(), world_from_index: rows, data: STANDARD.encode(data) }
            .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for SelectionVoxels {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let written = Written::deserialize(deserializer)?;
        read(&written).map_err(|what| {
            serde::de::Error::custom(format!("the painted voxels cannot be read: {what}; restore an older copy"))
        })
    }
}

/// A clause where the text is damaged.
fn read(written: &Written) -> Result<SelectionVoxels, String> {
    let [a, b, c] = written.world_from_index;
    let matrix = DMat3::from_cols_array_2d(&[a, b, c].map(|row| [row[0], row[1], row[2]])).transpose();
    let affine = DAffine3 { matrix3: matrix, translation: DVec3::new(a[3], b[3], c[3]) };
    let grid = Grid::new(written.dims, affine)?;
    let pool = Arc::new(BrickPool::default());
    let mut selection = Selection::empty(grid, &pool);
    let size = selection.size_in_bricks();
    let packed = STANDARD.decode(&written.data).map_err(|e| format!("their base64 is damaged ({e})"))?;
    let mut gzip = GzDecoder::new(&packed[..]);
    let mut bricks = Vec::new();
    let mut last = None;
    // One after the other: no more memory than a brick is taken before it is there.
    loop {
        let mut head = [0; 13];
        let mut first = [0];
        match gzip.read(&mut first) {
            Ok(0) => break,
            Ok(_) => head[0] = first[0],
            Err(e) => return Err(format!("they cannot be unpacked ({e})")),
        }
        let mut rest = |bytes: &mut [u8]| gzip.read_exact(bytes).map_err(|e| format!("they end too early ({e})"));
        rest(&mut head[1..])?;
        let place: [usize; 3] =
            std::array::from_fn(|i| u32::from_le_bytes(std::array::from_fn(|j| head[4 * i + j])) as usize);
        if (0..3).any(|i| place[i] >= size[i]) {
            return Err(format!("brick {place:?} lies outside of the {size:?} that the grid has"));
        }
        let order = [place[2], place[1], place[0]];
        if last.replace(order).is_some_and(|last| last >= order) {
            return Err(format!("brick {place:?} stands in the wrong order"));
        }
        let brick = match head[12] {
            0 => {
                let mut value = [0];
                rest(&mut value)?;
                Brick::Uniform(value[0])
            }
            1 => {
                let mut values = [0; BRICK_VOXELS];
                rest(&mut values)?;
                pool.brick(&values)
            }
            kind => return Err(format!("a brick is of kind {kind}, which does not exist")),
        };
        bricks.push((place, brick));
    }
    selection.replace(bricks);
    Ok(SelectionVoxels::new(selection))
}

impl JsonSchema for SelectionVoxels {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "SelectionVoxels".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        Written::json_schema(generator)
    }
}

const _: () = assert!(BRICK == 8, "the format of templates says so");

#[cfg(test)]
mod tests {
    use fabrica_engine::Progress;
    use fabrica_engine::selection::{Limits, Shape};

    use super::*;

    fn ball() -> SelectionVoxels {
        let affine = DAffine3::from_translation(DVec3::new(-10.0, 3.0, 0.1))
            * DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-0.7, 0.8, 3.0)));
        let grid = Grid::new([67, 50, 21], affine).unwrap();
        let center = affine.transform_point3(DVec3::new(60.0, 30.0, 10.0));
        let shape = Shape::ball(center, 12.0);
        let pool = Arc::new(BrickPool::default());
        SelectionVoxels::new(shape.select(&grid, &Limits::default(), &pool, &Progress::new()).unwrap())
    }

    #[test]
    fn voxels_go_through_text_and_back_byte_by_byte() {
        let ball = ball();
        assert!(ball.selection().num_voxels() > 1000.0);
        let text = serde_json::to_string(&ball).unwrap();
        let again: SelectionVoxels = serde_json::from_str(&text).unwrap();
        assert_eq!(again, ball);
        assert_eq!(serde_json::to_string(&again).unwrap(), text);
        // Some voxel differs.
        let mut other = ball.selection().clone();
        other.change([[60, 61], [30, 31], [10, 11]], |_, f| 255 - f);
        assert_ne!(SelectionVoxels::new(other), ball);
        let empty = SelectionVoxels::new(Selection::empty(*ball.selection().grid(), ball.selection().pool()));
        let text = serde_json::to_string(&empty).unwrap();
        assert_eq!(serde_json::from_str::<SelectionVoxels>(&text).unwrap(), empty);
    }

    #[test]
    fn damage_is_one_sentence() {
        let value = serde_json::to_value(ball()).unwrap();
        let data = value["data"].as_str().unwrap().to_owned();
        let cut = STANDARD.encode(&STANDARD.decode(&data).unwrap()[..100]);
        let gzip = |bytes: &[u8]| {
            let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
            gzip.write_all(bytes).unwrap();
            STANDARD.encode(gzip.finish().unwrap())
        };
        let outside = gzip(&[99, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 7]);
        let kind = gzip(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 7]);
        let twice = gzip(&[0; 28]);
        for (field, with, part) in [
            ("data", serde_json::json!("?"), "base64"),
            ("data", serde_json::json!("AAAA"), "unpacked"),
            ("data", serde_json::json!(cut), "unpacked"),
            ("data", serde_json::json!(outside), "outside"),
            ("data", serde_json::json!(kind), "kind 2"),
            ("data", serde_json::json!(twice), "order"),
            ("dims", serde_json::json!([0, 1, 1]), "0 voxels"),
            ("dims", serde_json::json!(vec![4_000_000_000_u64; 3]), "memory"),
        ] {
            let mut damaged = value.clone();
            damaged[field] = with;
            let said = serde_json::from_value::<SelectionVoxels>(damaged).unwrap_err().to_string();
            assert!(said.starts_with("the painted voxels cannot be read") && said.contains(part), "{said}");
            assert!(!said.contains('\n'), "{said}");
        }
    }

    #[test]
    fn copies_count_what_they_do_not_share() {
        let ball = ball();
        let mut edited = ball.selection().clone();
        edited.change([[60, 62], [30, 32], [10, 12]], |_, _| 3);
        let edited = SelectionVoxels::new(edited);
        let own = ball.unshared_bytes(&edited);
        assert!(own < 20_000 && own < ball.selection().num_bytes() / 4, "{own} of {}", ball.selection().num_bytes());
        assert!(ball.unshared_bytes(&ball) < 1000);
    }
}
