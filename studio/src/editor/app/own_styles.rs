//! Styles that are made of pictures: read, kept, and ready to dress with.

use std::path::Path;
use std::sync::Arc;

use eframe::egui::Context;
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::styles::extract::{self, Extracted};
use fabrica_engine::{Error, Result};

use super::super::dialogs::Dialog;
use super::super::files::Job;
use super::super::panels::styles::Fresh;
use super::super::style_from_picture::StyleFromPicture;
use super::super::wording;
use super::chrome::{Banner, Notice};
use super::{Editor, waker};

impl Editor {
    /// Reads a picture for the dialog that makes a style of it.
    pub(super) fn read_picture(&mut self, ctx: &Context, path: &Path) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        self.notice = Notice::now(format!("Reading {name}"));
        let file = path.to_owned();
        let job = Job::start(format!("Reading {name}"), waker(ctx), move |_| StyleFromPicture::read(&file));
        self.picturing = Some(job);
    }

    /// Takes in a picture that was read.
    pub(super) fn poll_picture(&mut self) {
        let Some(result) = self.picturing.as_ref().and_then(Job::finished) else { return };
        self.picturing = None;
        self.notice = Notice::default();
        match result {
            Ok(style) => self.dialog = Some(Dialog::Style(Box::new(style))),
            Err(error) => self.banner = Some(Banner::new(wording::sentence(&error))),
        }
    }

    /// Keeps a style among the user's own and shows it in the gallery; what cannot be kept stays in its dialog.
    pub(super) fn save_style(&mut self, ctx: &Context, style: Box<StyleFromPicture>) {
        let Some(found) = style.found() else {
            self.dialog = Some(Dialog::Style(style));
            return;
        };
        match self.keep_style(style.name(), found) {
            Ok(library) => {
                let library = Arc::new(library);
                self.painter.set_styles(library.clone());
                self.gallery.add(ctx, library, style.name());
                self.layout.search.clear();
                self.layout.fresh = Fresh { name: style.name().to_owned(), is_shown: false };
                // The gallery, which is drawn before dialogs are, has it in the next frame.
                ctx.request_repaint();
                self.notice = Notice::now(format!("The style {} is among your own", style.name()));
            }
            Err(error) => {
                self.banner = Some(Banner::new(wording::sentence(&error.into())));
                self.dialog = Some(Dialog::Style(style));
            }
        }
    }

    fn keep_style(&self, name: &str, found: &Extracted) -> Result<StyleLibrary> {
        let folder = self.styles_folder.as_ref().ok_or_else(|| {
            Error::scene("there is no folder for your own styles", "give Fabrica a home folder that it may write to")
        })?;
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
        let path = folder.join(format!("{name}.png"));
        extract::save(found, &path)?;
        Ok(StyleLibrary::clone(self.gallery.library()).with_file(&path))
    }
}
