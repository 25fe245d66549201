//! What is asked before a volume is read: which of several, which frame, how plain voxels lie, which part of it and how finely,
//! with what that takes. It is asked where it must be (several series, no layout, too little memory) and where the user wants it.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};

use anyhow::Result;
use eframe::egui::{
    self, CollapsingHeader, Color32, ColorImage, Context, DragValue, Grid, ScrollArea, Sense, TextureHandle,
    TextureOptions, Ui, Vec2,
};
use fabrica_engine::read::limits::{Limits, bytes_in_words};
use fabrica_engine::read::raw::{EXAMPLE, RawLayout};
use fabrica_engine::read::window::Window;
use fabrica_engine::read::{Entry, Numbers, ReadOptions, read_volume};
use fabrica_engine::volume::Volume;
use fabrica_engine::{Error, Progress};

use super::dialogs::{Choice, filled};
use super::panels::properties::shorter;
use super::theme;
use super::viewport::why_marked;
use crate::figure::template::VolumeSlot;
use crate::memory;

/// Edge of a preview, in points.
const PREVIEW: f32 = 56.0;
/// Edge of a preview, in pixels.
const PREVIEW_PIXELS: usize = 112;

/// What is asked, and what was answered so far.
pub struct VolumeChoice {
    /// The slot that is filled, in a figure that is open; none: a figure of its own.
    pub place: Option<usize>,
    slot: VolumeSlot,
    path: PathBuf,
    entries: Vec<Entry>,
    chosen: usize,
    /// What is typed as the layout of plain voxels.
    layout: Option<String>,
    frame: usize,
    numbers: Numbers,
    crop: [[usize; 2]; 3],
    reduce: [usize; 3],
    limits: Limits,
    /// Whether it is asked because the whole does not fit.
    is_too_large: bool,
    previews: Option<Previews>,
    /// Why it could not be read as it was answered.
    fault: Option<String>,
    /// Whether it was shown before.
    has_begun: bool,
}

impl VolumeChoice {
    /// What has to be asked when `slot`, whose file lies at `path`, was read and `error` came of it; none if no answer helps.
    pub fn after(error: &anyhow::Error, slot: &VolumeSlot, place: Option<usize>, limits: Limits) -> Option<Self> {
        match error.downcast_ref()? {
            Error::Several { path, entries } => Some(Self::new(path, slot, place, entries.clone(), limits)),
            Error::TooLarge(fault) => {
                let mut choice = Self::new(&fault.path, slot, place, vec![fault.entry.clone()], fault.limits);
                choice.reduce = fault.fitting.reduce;
                choice.is_too_large = true;
                Some(choice)
            }
            Error::NeedsLayout { path, guess } => {
                let mut choice = Self::new(path, slot, place, Vec::new(), limits);
                choice.layout = Some(guess.as_ref().map_or(String::new(), ToString::to_string));
                Some(choice)
            }
            _ => None,
        }
    }

    /// Asks how `slot`, whose file lies at `path` and offers `entries`, shall be read.
    pub fn new(path: &Path, slot: &VolumeSlot, place: Option<usize>, entries: Vec<Entry>, limits: Limits) -> Self {
        let named = |e: &Entry| slot.series.as_ref().is_some_and(|s| *s == e.key);
        let limits = Limits { bytes: limits.bytes.or_else(memory::free_bytes), ..limits };
        let mut choice = Self {
            place,
            slot: slot.clone(),
            path: path.to_owned(),
            chosen: entries.iter().position(named).unwrap_or_else(|| likely(&entries)),
            layout: slot.raw.clone(),
            frame: slot.frame,
            numbers: if slot.labels { Numbers::Structures } else { Numbers::Values },
            crop: [[0, 1]; 3],
            reduce: slot.reduce.unwrap_or([1; 3]),
            limits,
            is_too_large: false,
            previews: None,
            fault: None,
            has_begun: false,
            entries,
        };
        choice.crop = choice.whole();
        // A template may have been written by hand, or for another file.
        let kept = Window { crop: slot.crop, reduce: choice.reduce };
        match (choice.entry().map(|e| kept.on(path, e.grid.dims())), slot.crop) {
            (Some(Ok(_)), Some(crop)) => choice.crop = crop,
            (Some(Err(_)), _) => choice.reduce = [1; 3],
            _ => {}
        }
        choice
    }

    /// The same question once more, after the answer led to `fault`.
    #[must_use]
    pub fn refused(self, fault: String) -> Self {
        let mut letters = fault.chars();
        let first = letters.next().into_iter().flat_map(char::to_uppercase);
        Self { fault: Some(first.chain(letters).collect()), has_begun: false, ..self }
    }

    /// The slot as it is answered, and what reading may take: no limit once the user wants it all the same.
    pub fn answer(&self) -> Result<(VolumeSlot, Limits)> {
        let options = self.options()?;
        let bytes = if self.is_within() { None } else { Some(u64::MAX) };
        Ok((self.slot.reading(self.slot.file.clone(), &options), Limits { bytes, edge: self.limits.edge }))
    }

    fn options(&self) -> Result<ReadOptions> {
        let raw = self.layout.as_deref().map(str::parse::<RawLayout>).transpose()?;
        let several = self.entries.len() > 1;
        Ok(ReadOptions {
            frame: self.frame,
            raw,
            series: self.entry().filter(|_| several).map(|e| e.key.clone()),
            window: self.window(),
            numbers: self.numbers,
            limits: Limits::default(),
        })
    }

    fn entry(&self) -> Option<&Entry> {
        self.entries.get(self.chosen)
    }

    fn whole(&self) -> [[usize; 2]; 3] {
        self.entry().map_or([[0, 1]; 3], |e| e.grid.dims().map(|n| [0, n]))
    }

    fn window(&self) -> Window {
        Window { crop: Some(self.crop).filter(|c| self.entry().is_some() && *c != self.whole()), reduce: self.reduce }
    }

    fn is_within(&self) -> bool {
        let Some(entry) = self.entry() else { return true };
        let entry = entry.taken_for(self.numbers);
        self.window().on(&self.path, entry.grid.dims()).is_ok_and(|part| self.limits.admit(&entry, &part))
    }

    fn choose(&mut self, which: usize) {
        self.chosen = which;
        (self.frame, self.reduce) = (0, [1; 3]);
        self.crop = self.whole();
    }

    /// The dialog's contents; how it ended, if it did.
    pub fn show(&mut self, ui: &mut Ui) -> Option<Choice> {
        // Enter ends what is typed in a field before it ends the dialog.
        let is_typing = ui.memory(|m| m.focused().is_some());
        let name = self.path.file_name().unwrap_or(self.path.as_os_str()).to_string_lossy().into_owned();
        let (title, text) = if self.layout.is_some() {
            ("How do the voxels lie?", format!("{name} holds plain voxels, without a word about them."))
        } else if self.entries.len() > 1 {
            ("Which volume?", format!("{name} holds {} of them.", self.entries.len()))
        } else if self.is_too_large {
            let entry_fits = |e: &Entry| self.limits.edge.is_none_or(|edge| e.grid.dims().iter().all(|n| *n <= edge));
            let why = if self.entry().is_none_or(entry_fits) {
                "takes more memory than is free"
            } else {
                "is longer than the adapter takes along an axis"
            };
            ("Load less of it?", format!("{name} {why}."))
        } else {
            ("What is loaded", name)
        };
        ui.heading(title);
        ui.add(egui::Label::new(text).wrap()).on_hover_text(self.path.display().to_string());
        ui.add_space(6.0);
        let mut fault = None;
        if self.layout.is_some() {
            fault = self.show_layout(ui);
        }
        let mut accepted = self.entries.len() > 1 && self.list(ui, !is_typing);
        if let Some(num_frames) = self.entry().map(|e| e.num_frames).filter(|n| *n > 1) {
            ui.horizontal(|ui| {
                let mut number = self.frame.min(num_frames - 1) + 1;
                let label = ui.label("Frame");
                ui.add(DragValue::new(&mut number).range(1..=num_frames)).labelled_by(label.id);
                ui.label(theme::small(ui.ctx(), format!("of {num_frames}")));
                self.frame = number - 1;
            });
        }
        self.show_numbers(ui);
        if self.entry().is_some() {
            let is_part = self.is_too_large || !self.window().is_whole();
            let header = CollapsingHeader::new("Part and resolution").default_open(is_part).id_salt("part");
            header.show(ui, |ui| self.show_part(ui));
            self.show_cost(ui);
        }
        if let (Some(refusal), None) = (&self.fault, &fault) {
            ui.add(egui::Label::new(egui::RichText::new(refusal).color(theme::tokens(ui.ctx()).error)).wrap());
        }
        let mut choice = None;
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let can_open = fault.is_none();
            let within = self.is_within();
            // The layout is all that is typed there: Enter means it.
            let entered = (!is_typing || self.layout.is_some()) && ui.input(|i| i.key_pressed(egui::Key::Enter));
            let verb = if within { "Open" } else { "Open all the same" };
            let clicked = ui.add_enabled_ui(can_open, |ui| {
                if within { filled(ui, verb).clicked() } else { ui.button(verb).clicked() }
            });
            accepted |= clicked.inner || (entered && within);
            if !within && filled(ui, "Reduce until it fits").clicked() {
                self.reduce_to_fit();
            }
            if ui.button("Cancel").clicked() {
                choice = Some(Choice::Cancel);
            }
            if accepted && can_open {
                choice = Some(Choice::Accept);
            }
        });
        choice
    }

    /// What the numbers are, for a figure that is open: another one finds out by itself.
    fn show_numbers(&mut self, ui: &mut Ui) {
        if self.place.is_none() || self.entry().is_none_or(|e| e.type_name.starts_with("rgb")) {
            return;
        }
        ui.horizontal(|ui| {
            ui.label("Its numbers are");
            for (numbers, text, tooltip) in [
                (Numbers::Values, "Values of a scan", "A mask or label map is then drawn as one surface"),
                (Numbers::Structures, "Structures", "Each number names a structure, which is drawn in its color"),
            ] {
                if ui.selectable_label(self.numbers == numbers, text).on_hover_text(tooltip).clicked() {
                    self.numbers = numbers;
                }
            }
        });
    }

    /// The field for the layout; what is wrong with what is typed.
    fn show_layout(&mut self, ui: &mut Ui) -> Option<String> {
        let text = self.layout.as_mut()?;
        let label = ui.label("Layout");
        let field = theme::text_field(text).hint_text("256x256x128xuint8").desired_width(f32::INFINITY);
        let field = ui.add(field).labelled_by(label.id);
        if field.changed() {
            self.fault = None;
        }
        // Enter on what cannot be leaves one where it can be mended.
        if !self.has_begun || (field.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter))) {
            field.request_focus();
            self.has_begun = true;
        }
        let parsed = text.trim().parse::<RawLayout>();
        let fault = parsed.map_or_else(|e| Some(e.to_string()), |layout| layout.misfit(&self.path));
        match &fault {
            Some(fault) if !text.trim().is_empty() => drop(ui.colored_label(theme::tokens(ui.ctx()).warning, fault)),
            _ => drop(ui.label(theme::small(ui.ctx(), format!("As in {EXAMPLE}")))),
        }
        fault
    }

    /// The volumes to choose from; whether one was taken at once.
    fn list(&mut self, ui: &mut Ui, has_keys: bool) -> bool {
        let previews = self.previews.get_or_insert_with(|| Previews::start(ui.ctx(), &self.path, &self.entries));
        previews.poll(ui.ctx());
        let pressed = |key| has_keys && ui.input(|i| i.key_pressed(key));
        let (up, down) = (pressed(egui::Key::ArrowUp), pressed(egui::Key::ArrowDown));
        let next = (self.chosen + usize::from(down)).saturating_sub(usize::from(up)).min(self.entries.len() - 1);
        let mut clicked = Some(next).filter(|_| up || down);
        let mut taken = false;
        ScrollArea::vertical().max_height(300.0).auto_shrink([false, true]).show(ui, |ui| {
            for (i, entry) in self.entries.iter().enumerate() {
                let named =
                    if entry.title.is_empty() { format!("Series {} (no name)", i + 1) } else { entry.title.clone() };
                let response =
                    row(ui, i == self.chosen, &named, entry, previews.textures.get(i).and_then(Option::as_ref));
                if response.clicked() {
                    clicked = Some(i);
                }
                if (up || down) && i == next {
                    response.scroll_to_me(None);
                }
                taken |= response.double_clicked();
            }
        });
        if let Some(which) = clicked.filter(|which| *which != self.chosen) {
            self.choose(which);
        }
        taken
    }

    fn show_part(&mut self, ui: &mut Ui) {
        let Some(dims) = self.entry().map(|e| e.grid.dims()) else { return };
        // Which way an index leads, as people say it.
        let letters = self.entry().map(|e| e.grid.orientation_letters()).unwrap_or_default();
        let ways: Vec<&str> = letters.chars().map(way).collect();
        let assumption = self.entry().and_then(|e| e.orientation.assumption()).map(why_marked);
        let mark = if assumption.is_some() { " (?)" } else { "" };
        Grid::new("part").num_columns(6).spacing([8.0, 4.0]).show(ui, |ui| {
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                let [mut first, mut end] = self.crop[axis];
                let label = ui.label(format!("Along {name}, {}{mark}", ways[axis]));
                assumption.as_deref().map(|why| label.on_hover_text(why));
                let from = DragValue::new(&mut first).range(0..=end - 1);
                ui.add(from).accessible_name(format!("First voxel along {name}"));
                ui.label("to");
                let to = DragValue::new(&mut end).range(first + 1..=dims[axis]);
                let tooltip = "The first voxel that is left out";
                ui.add(to).accessible_name(format!("End along {name}")).on_hover_text(tooltip);
                ui.label("one voxel of");
                let reduce = DragValue::new(&mut self.reduce[axis]).range(1..=64);
                ui.add(reduce).accessible_name(format!("Reduction along {name}"));
                self.crop[axis] = [first, end];
                ui.end_row();
            }
        });
        if let Some(why) = &assumption {
            let text = egui::RichText::new(why).size(12.0).color(theme::tokens(ui.ctx()).warning);
            ui.add(egui::Label::new(text).wrap());
        }
        if ui.button("All of it").clicked() {
            (self.crop, self.reduce) = (self.whole(), [1; 3]);
        }
    }

    fn show_cost(&self, ui: &mut Ui) {
        let Some(entry) = self.entry().map(|e| e.taken_for(self.numbers)) else { return };
        let Ok(part) = self.window().on(&self.path, entry.grid.dims()) else { return };
        let Ok(grid) = part.grid(&entry.grid) else { return };
        let ([x, y, z], mm, cost) = (part.dims(), grid.spacing_mm(), entry.cost(&part));
        let size = format!("{x} x {y} x {z} voxels of {} x {} x {} mm", shorter(mm.x), shorter(mm.y), shorter(mm.z));
        ui.label(size);
        let takes =
            format!("takes {}, and {} on the adapter", bytes_in_words(cost.voxels), bytes_in_words(cost.adapter));
        let free = self.limits.bytes.map_or(String::new(), |free| format!("; {} are free", bytes_in_words(free)));
        let text = takes + &free;
        if self.limits.admit(&entry, &part) {
            ui.label(theme::small(ui.ctx(), text));
        } else {
            ui.colored_label(theme::tokens(ui.ctx()).warning, text);
        }
    }

    fn reduce_to_fit(&mut self) {
        let fitting = self.entry().map(|e| e.taken_for(self.numbers));
        let fitting = fitting.and_then(|entry| self.limits.fit(&self.path, &entry, &self.window()).ok());
        if let Some(fitting) = fitting {
            self.reduce = fitting.reduce;
        }
    }
}

/// One volume of the list.
fn row(ui: &mut Ui, is_chosen: bool, name: &str, entry: &Entry, preview: Option<&TextureHandle>) -> egui::Response {
    let size = Vec2::new(ui.available_width(), PREVIEW + 8.0);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    response.widget_info(|| egui::WidgetInfo::selected(egui::Role::ListBoxOption, true, is_chosen, name));
    let visuals = ui.style().interact_selectable(&response, is_chosen);
    if is_chosen || response.hovered() || response.has_focus() {
        ui.painter().rect_filled(rect, 4.0, visuals.bg_fill);
    }
    let frame = egui::Rect::from_min_size(rect.min + Vec2::splat(4.0), Vec2::splat(PREVIEW));
    ui.painter().rect_filled(frame, 2.0, Color32::BLACK);
    if let Some(texture) = preview {
        let [w, h] = texture.size().map(|n| n as f32);
        let shown = egui::Rect::from_center_size(frame.center(), Vec2::new(w, h) * (PREVIEW / w.max(h)));
        let uv = egui::Rect::from_min_max(egui::Pos2::ZERO, egui::Pos2::new(1.0, 1.0));
        ui.painter().image(texture.id(), shown, uv, Color32::WHITE);
    }
    let text = rect.with_min_x(frame.max.x + 10.0).shrink2(Vec2::new(0.0, 6.0));
    // A child of its own leaves the place of the next row alone.
    let mut child = ui.new_child(egui::UiBuilder::new().max_rect(text));
    {
        let ui = &mut child;
        ui.spacing_mut().item_spacing.y = 1.0;
        let [x, y, z] = entry.grid.dims();
        let mm = entry.grid.spacing_mm();
        let frames = if entry.num_frames > 1 { format!(", {} frames", entry.num_frames) } else { String::new() };
        ui.add(egui::Label::new(egui::RichText::new(name).color(visuals.text_color())).truncate().selectable(false));
        let size = format!("{x} x {y} x {z} voxels{frames}");
        let kind = match (entry.modality.abbreviation(), entry.is_labels) {
            (_, true) => "label map, ".to_owned(),
            ("", _) => String::new(),
            (name, _) => format!("{name}, "),
        };
        let spacing = format!("{kind}{} x {} x {} mm", shorter(mm.x), shorter(mm.y), shorter(mm.z));
        for line in [size, spacing] {
            ui.add(egui::Label::new(theme::small(ui.ctx(), line)).truncate().selectable(false));
        }
    }
    response
}

/// Where an axis leads, from its letter.
fn way(letter: char) -> &'static str {
    match letter {
        'R' => "to the right",
        'L' => "to the left",
        'A' => "to the front",
        'P' => "to the back",
        'S' => "upward",
        _ => "downward",
    }
}

/// The volume that is most likely meant: scans have more voxels than localizers and single pictures.
fn likely(entries: &[Entry]) -> usize {
    let size = |e: &Entry| (e.grid.dims().iter().all(|n| *n > 3), e.grid.num_voxels());
    (0..entries.len()).max_by_key(|&i| (size(&entries[i]), std::cmp::Reverse(i))).unwrap_or(0)
}

/// Pictures of the middle slices, made on a thread.
struct Previews {
    progress: Progress,
    receiver: Receiver<(usize, ColorImage)>,
    textures: Vec<Option<TextureHandle>>,
}

impl Previews {
    fn start(ctx: &Context, path: &Path, entries: &[Entry]) -> Self {
        let (sender, receiver) = channel();
        let progress = Progress::new();
        let (theirs, path, entries_there, ctx) = (progress.clone(), path.to_owned(), entries.to_vec(), ctx.clone());
        std::thread::spawn(move || draw_all(&ctx, &path, &entries_there, &sender, &theirs));
        Self { progress, receiver, textures: vec![None; entries.len()] }
    }

    fn poll(&mut self, ctx: &Context) {
        while let Ok((which, image)) = self.receiver.try_recv() {
            let name = format!("preview {which}");
            self.textures[which] = Some(ctx.load_texture(name, image, TextureOptions::LINEAR));
        }
    }
}

impl Drop for Previews {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}

fn draw_all(ctx: &Context, path: &Path, entries: &[Entry], sender: &Sender<(usize, ColorImage)>, progress: &Progress) {
    for (which, entry) in entries.iter().enumerate() {
        // Best effort: a series that cannot be read says so when it is chosen.
        match preview(path, entry, progress) {
            Ok(image) => {
                if sender.send((which, image)).is_err() {
                    return;
                }
                ctx.request_repaint();
            }
            Err(Error::Cancelled) => return,
            Err(_) => {}
        }
    }
}

/// The middle slice, its values from black to white, in the body's upright position as far as its axes allow.
fn preview(path: &Path, entry: &Entry, progress: &Progress) -> std::result::Result<ColorImage, Error> {
    let [nx, ny, nz] = entry.grid.dims();
    let crop = Some([[0, nx], [0, ny], [nz / 2, nz / 2 + 1]]);
    let step = nx.max(ny).div_ceil(2 * PREVIEW_PIXELS);
    let window = Window { crop, reduce: [step, step, 1] };
    let series = Some(entry.key.clone()).filter(|k| !k.is_empty());
    let options = ReadOptions { series, window, ..ReadOptions::default() };
    let volume = read_volume(path, &options, progress)?;
    picture(&volume, progress)
}

fn picture(volume: &Volume, progress: &Progress) -> std::result::Result<ColorImage, Error> {
    let [nx, ny, _] = volume.grid.dims();
    let statistics = volume.statistics(progress)?;
    let (low, high) = (statistics.percentile(1.0), statistics.percentile(99.5));
    let scale = if high > low { 255.0 / (high - low) } else { 0.0 };
    let mm = volume.grid.spacing_mm();
    let size_mm = [nx as f64 * mm.x, ny as f64 * mm.y];
    let pixel_mm = size_mm[0].max(size_mm[1]) / PREVIEW_PIXELS as f64;
    let [w, h] = size_mm.map(|mm| ((mm / pixel_mm).round() as usize).clamp(1, PREVIEW_PIXELS));
    let letters: Vec<char> = volume.grid.orientation_letters().chars().collect();
    let flips = [letters[0] == 'R', matches!(letters[1], 'A' | 'S')];
    let mut pixels = Vec::with_capacity(w * h);
    for row in 0..h {
        for column in 0..w {
            let at = |i: usize, n: usize, pixels: usize, flip: bool| {
                let i = if flip { pixels - 1 - i } else { i };
                (i * n / pixels).min(n - 1)
            };
            let (x, y) = (at(column, nx, w, flips[0]), at(row, ny, h, flips[1]));
            pixels.push(match &volume.colors {
                Some(colors) => {
                    let [r, g, b, a] = colors[x + nx * y];
                    Color32::from_rgba_unmultiplied(r, g, b, a)
                }
                None => Color32::from_gray(((volume.value(x, y, 0) - low) * scale).clamp(0.0, 255.0) as u8),
            });
        }
    }
    Ok(ColorImage::new([w, h], pixels))
}
