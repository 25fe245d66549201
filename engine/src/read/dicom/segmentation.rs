//! DICOM segmentations (SEG) as label maps.
use super::file::DicomFile;
use super::image::Image;
use super::series::Stack;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::read::window::OnGrid;
use crate::volume::labels::LabelMap;

pub fn stack_of(_index: usize, file: &DicomFile, _image: &Image) -> Result<Stack> {
    Err(Error::file(&file.path, "todo", "todo"))
}
pub fn layers(file: &DicomFile, _window: OnGrid, _progress: &Progress) -> Result<Vec<LabelMap>> {
    Err(Error::file(&file.path, "todo", "todo"))
}
