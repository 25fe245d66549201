//! Volumes to files: NRRD, which keeps affine, type and values exactly.

use std::io::Write as _;
use std::path::Path;

use crate::error::{Error, Result};
use crate::image_out::save_atomic;
use crate::spaces::Grid;
use crate::volume::{Rescale, Volume, Voxel as _};
use crate::with_voxels;

/// Writes a volume as uncompressed NRRD in RAS, in this machine's byte order, the stored numbers where they
/// are data values, else the data values as float32. The file appears whole or not at all.
///
/// # Errors
/// [`Error::File`] if it cannot be written.
pub fn write_nrrd(path: &Path, volume: &Volume) -> Result<()> {
    let [nx, ny, nz] = volume.grid.dims();
    let (directions, origin) = nrrd_place(&volume.grid);
    let endian = if cfg!(target_endian = "big") { "big" } else { "little" };
    let stored = volume.rescale == Rescale::IDENTITY;
    let type_name = if stored { volume.voxels.type_name() } else { "float32" };
    let mut header = format!(
        "NRRD0004\ntype: {}\ndimension: 3\nspace: right-anterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {directions}\nspace origin: {origin}\nkinds: domain domain domain\nendian: {endian}\nencoding: raw\n",
        type_name.replace("float32", "float").replace("float64", "double"),
    );
    header.push('\n');
    save_atomic(path, |file| {
        let io = |e| Error::io(path, &e);
        file.write_all(header.as_bytes()).map_err(io)?;
        with_voxels!(&volume.voxels, v => if stored {
            file.write_all(bytemuck::cast_slice(v)).map_err(io)
        } else {
            v.chunks(1 << 16).try_for_each(|chunk| {
                let values: Vec<f32> = chunk.iter().map(|s| volume.rescale.value(s.to_f64()) as f32).collect();
                file.write_all(bytemuck::cast_slice(&values)).map_err(io)
            })
        })
    })
}

/// `space directions` of the three axes and `space origin` of a NRRD header in RAS mm, to the last bit.
pub(crate) fn nrrd_place(grid: &Grid) -> (String, String) {
    let affine = grid.world_from_index();
    let vector = |v: glam::DVec3| format!("({:?},{:?},{:?})", v.x, v.y, v.z);
    let m = affine.matrix3;
    ([m.x_axis, m.y_axis, m.z_axis].map(vector).join(" "), vector(affine.translation))
}
