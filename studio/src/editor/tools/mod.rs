//! Tools: what the primary button does in the figure and in slices. Each is a small machine that follows the hand and edits the
//! document in gestures; navigation goes on beside it with the other buttons.

pub mod bar;
mod brush;
mod grow;
mod lasso;
mod rectangle;
pub mod target;
mod view;
mod work;

use std::sync::Arc;
use std::time::Instant;

use eframe::egui::{Align2, Color32, Context, CursorIcon, Event, FontId, Key, Painter, PointerButton, Pos2, Ui, Vec2};
use fabrica_engine::Progress;
use fabrica_engine::selection::{Combination, Edge, Limits, ValueLimit};
use fabrica_engine::volume::{Modality, Volume};

pub use self::target::Aim;
pub use self::view::{FigureView, View};
use self::work::Work;
use super::open_figure::OpenFigure;
use super::panels::properties::shorter;
use super::slices::pane::is_tools;
use super::ui_command::UiCommand;
use crate::figure::command::Chosen;
use crate::figure::template::{Domain, NodeTemplate};

/// What the primary button does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// What it always does: asks, turns the figure, moves the crosshair.
    #[default]
    Select,
    /// Paints a selection.
    Brush,
    /// Selects what is in a loop.
    Lasso,
    /// Selects what is in a rectangle.
    Rectangle,
    /// Selects what hangs together with a seed.
    Grow,
}

impl Tool {
    /// In the order of the strip.
    pub const ALL: [Self; 5] = [Self::Select, Self::Brush, Self::Lasso, Self::Rectangle, Self::Grow];

    /// The command that takes it up.
    pub fn command(self) -> UiCommand {
        match self {
            Self::Select => UiCommand::SelectTool,
            Self::Brush => UiCommand::BrushTool,
            Self::Lasso => UiCommand::LassoTool,
            Self::Rectangle => UiCommand::RectangleTool,
            Self::Grow => UiCommand::GrowTool,
        }
    }

    /// What the hand can do with it.
    fn hint(self) -> Option<&'static str> {
        match self {
            Self::Select => None,
            Self::Brush => {
                Some("Drag: paint · Alt+drag: erase · Shift+drag or [ ]: radius · Middle drag: orbit · Esc: give up")
            }
            Self::Lasso => Some(
                "Drag: loop · Clicks: corners, double-click or Enter closes, Backspace takes one back · Begin with Shift: add, \
                 Alt: subtract, both: intersect",
            ),
            Self::Rectangle => Some(
                "Drag: rectangle, then Shift: square · Begin with Shift: add, Alt: subtract, both: intersect · Esc: give up",
            ),
            Self::Grow => Some(
                "Click: seed · Drag to the side or wheel: tolerance · Click: more, Alt+click: bar · Enter: accept · Esc: drop",
            ),
        }
    }
}

/// What tools do with what they select: as in Krita, whose keys they have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// It takes the place of the selection.
    Replace,
    /// It goes into it.
    #[default]
    Add,
    /// It is taken out of it.
    Subtract,
    /// What lies in both is left.
    Intersect,
}

impl Mode {
    /// In the order of the bar.
    pub const ALL: [Self; 4] = [Self::Replace, Self::Add, Self::Subtract, Self::Intersect];

    /// The command that chooses it.
    pub fn command(self) -> UiCommand {
        match self {
            Self::Replace => UiCommand::ReplaceMode,
            Self::Add => UiCommand::AddMode,
            Self::Subtract => UiCommand::SubtractMode,
            Self::Intersect => UiCommand::IntersectMode,
        }
    }

    /// As it is for an edit that begins with these keys held: Shift adds, Alt takes away, both leave what lies in both. Where it is
    /// taken away anyway, Alt adds.
    fn held(self, shift: bool, alt: bool) -> Self {
        match (shift, alt) {
            (false, false) => self,
            (true, true) => Self::Intersect,
            (true, false) => Self::Add,
            (false, true) if self == Self::Subtract => Self::Add,
            (false, true) => Self::Subtract,
        }
    }

    /// How the engine calls it.
    fn combination(self) -> Combination {
        match self {
            Self::Replace => Combination::Replace,
            Self::Add => Combination::Union,
            Self::Subtract => Combination::Subtract,
            Self::Intersect => Combination::Intersect,
        }
    }
}

/// The settings of all tools.
#[derive(Clone, Debug)]
pub struct Settings {
    /// What is painted.
    pub target: Aim,
    /// What happens with what is selected; the brush takes away or, in all other modes, adds.
    pub mode: Mode,
    /// Of the brush; none: as it suits the volume.
    radius_mm: Option<f64>,
    /// Whether the brush fades from its center.
    pub is_soft: bool,
    /// The data values that may be selected, if not all.
    pub range: Option<[f64; 2]>,
    /// Only what hangs together with the middle of the brush.
    pub is_connected: bool,
    /// In the figure, only voxels that the transfer function shows.
    pub is_visible_only: bool,
    /// Whether a loop in the figure reaches no deeper than the first surface, and in a slice no further than its layer.
    pub is_surface_only: bool,
    /// How deep under the surface, mm; none: as it suits the volume.
    depth_mm: Option<f64>,
    /// How unlike its seeds a region may be, in units of the values; none: as it suits the volume.
    tolerance: Option<f64>,
    /// By how much selections grow, shrink and are smoothed; none: as it suits the volume.
    refine_mm: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            target: Aim::New,
            mode: Mode::Add,
            radius_mm: None,
            is_soft: false,
            range: None,
            is_connected: false,
            is_visible_only: true,
            is_surface_only: false,
            depth_mm: None,
            tolerance: None,
            refine_mm: None,
        }
    }
}

/// Spacing of the chosen volume, mm, the smallest and the largest, and its longest edge.
fn lengths_mm(open: &OpenFigure) -> [f64; 3] {
    let Some(volume) = open.chosen_volume() else { return [1.0, 1.0, 100.0] };
    let spacing = volume.grid.spacing_mm();
    let size = volume.grid.dims().map(|n| n as f64);
    let longest = (0..3).map(|a| spacing[a] * size[a]).fold(0.0, f64::max);
    [spacing.min_element(), spacing.max_element(), longest]
}

impl Settings {
    /// Whether the brush takes away; Alt turns it around.
    pub fn erases(&self) -> bool {
        self.mode == Mode::Subtract
    }

    /// Radius of the brush.
    pub fn radius_mm(&self, open: &OpenFigure) -> f64 {
        let [_, _, longest] = lengths_mm(open);
        let radius = self.radius_mm.unwrap_or_else(|| round(0.03 * longest));
        radius.clamp(self.least_radius_mm(open), longest)
    }

    /// Half a voxel: less paints nothing.
    pub fn least_radius_mm(&self, open: &OpenFigure) -> f64 {
        0.5 * lengths_mm(open)[0]
    }

    /// Another radius, as far as it makes sense.
    pub fn set_radius_mm(&mut self, open: &OpenFigure, radius_mm: f64) {
        let [least, _, most] = lengths_mm(open);
        self.radius_mm = Some(radius_mm.clamp(0.5 * least, most));
    }

    /// By how much selections grow, shrink and are smoothed.
    pub fn refine_mm(&self, open: &OpenFigure) -> f64 {
        let [_, spacing, _] = lengths_mm(open);
        self.refine_mm.unwrap_or_else(|| round(spacing))
    }

    /// How deep under the first surface a loop reaches.
    pub fn depth_mm(&self, open: &OpenFigure) -> f64 {
        let [_, spacing, _] = lengths_mm(open);
        self.depth_mm.unwrap_or_else(|| round(3.0 * spacing))
    }

    /// How unlike its seeds a region may be: of scans in HU 60 at first, else a twentieth of the range of the values.
    pub fn tolerance(&self, open: &OpenFigure) -> f64 {
        let first = || {
            let Some(volume) = open.chosen_volume() else { return 1.0 };
            if volume.modality == Modality::Ct {
                return 60.0;
            }
            let (low, high) = volume.bricks().range();
            let range = (volume.rescale.value(high) - volume.rescale.value(low)).abs();
            if range > 0.0 { round(0.05 * range) } else { 1.0 }
        };
        self.tolerance.unwrap_or_else(first).clamp(1e-6, 1e6)
    }

    /// What the settings say about where tools may select in a view.
    fn limits(&self, open: &OpenFigure, volume: &Arc<Volume>, view: &View) -> Limits {
        let is_colors = volume.colors.is_some();
        let values = self.range.filter(|_| !is_colors).map(|[low, high]| ValueLimit {
            scan: volume.clone(),
            low: low.min(high),
            high: high.max(low),
            edge: Edge::default(),
        });
        // Slices show everything.
        let is_figure = matches!(view, View::Figure(_));
        let shown = (self.is_visible_only && is_figure).then(|| visible(open, volume)).flatten();
        Limits { values, connected: self.is_connected, allowed: shown }
    }
}

/// Two significant digits.
fn round(number: f64) -> f64 {
    let scale = 10f64.powf(number.log10().floor() - 1.0);
    (number / scale).round() * scale
}

/// Opacity of a reference length from which on a voxel counts as shown.
const SHOWN: f64 = 0.02;

type Allowed = Arc<dyn Fn([usize; 3]) -> bool + Send + Sync>;

/// Whether the object's transfer function shows a voxel, or one beside it; none for colors, whose opacity is their own.
fn visible(open: &OpenFigure, volume: &Arc<Volume>) -> Option<Allowed> {
    let function = &open.chosen()?.transfer_function;
    if volume.colors.is_some() {
        return None;
    }
    let value: Box<dyn Fn(f64) -> f64> = match function.domain {
        Domain::Data => Box::new(|at| at),
        Domain::Percentile => {
            let statistics = volume.known_statistics()?;
            Box::new(|at| statistics.percentile_above_background(at))
        }
    };
    let row = |row: usize| {
        let node = |node: &NodeTemplate| fabrica_engine::scene::TransferFunctionNode {
            value: value(node.at),
            style: 0,
            opacity: node.opacity,
        };
        fabrica_engine::scene::StyleTransferFunction::new(function.nodes_of(row).iter().map(node).collect(), 1.0)
    };
    let rows: Vec<_> = (0..function.num_rows()).map(row).collect();
    let (volume, dims) = (volume.clone(), volume.grid.dims());
    let is_shown = move |[x, y, z]: [usize; 3]| {
        let value = volume.value(x, y, z);
        rows.iter().any(|row| row.classify(value).opacity >= SHOWN)
    };
    // With the voxels beside them: a surface passes between voxels that are shown and voxels that are not, and a selection of
    // the former alone would end within it, in a pattern of dots.
    Some(Arc::new(move |voxel| {
        let near = |a: usize| voxel[a].saturating_sub(1)..(voxel[a] + 2).min(dims[a]);
        is_shown(voxel) || near(2).any(|z| near(1).any(|y| near(0).any(|x| is_shown([x, y, z]))))
    }))
}

/// What the hand did, in the order in which it did it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hand {
    Pressed { at: Pos2, shift: bool, alt: bool },
    Moved(Pos2),
    Released,
}

/// All tools, and which of them is in the hand.
#[derive(Default)]
pub struct Tools {
    active: Tool,
    /// What the option bar shows.
    pub settings: Settings,
    brush: brush::Brush,
    lasso: lasso::Lasso,
    rectangle: rectangle::Rectangle,
    grow: grow::Grow,
    work: Option<Work>,
    /// The view that the primary button was pressed in and still is.
    held: Option<View>,
    /// Of frames with dabs: what those took, with their edit, ms.
    dab_ms: Vec<f64>,
    /// What is to be said, until it is.
    said: Option<String>,
    /// What was chosen beside the picture, so that choosing something else there is noticed.
    chosen: Option<Aim>,
    /// The slot of a copy, and the structure of which object it is drawn in place of: what is aimed at when it is undone.
    copied: Option<(String, usize, Chosen)>,
}

impl Tools {
    /// Another figure is open: nothing of the old one is left, but for how tools are set.
    pub fn forget_figure(&mut self) {
        let settings = Settings {
            mode: self.settings.mode,
            is_soft: self.settings.is_soft,
            is_connected: self.settings.is_connected,
            is_visible_only: self.settings.is_visible_only,
            is_surface_only: self.settings.is_surface_only,
            ..Settings::default()
        };
        let dab_ms = std::mem::take(&mut self.dab_ms);
        *self = Self { active: self.active, settings, dab_ms, ..Self::default() };
    }

    /// The tool in the hand.
    pub fn active(&self) -> Tool {
        self.active
    }

    /// Takes up a tool.
    pub fn take(&mut self, tool: Tool, open: Option<&mut OpenFigure>) {
        // A region that is looked at is accepted.
        if let Some(open) = open.filter(|_| self.brush.is_busy() || self.grow.is_open()) {
            open.document.commit();
        }
        self.abort();
        self.active = tool;
    }

    /// Escape: what is not finished is given up; whether anything was. The document's gesture is given up beside it.
    pub fn abort(&mut self) -> bool {
        let was_open = self.lasso.is_open() || self.rectangle.is_open();
        self.brush.abort();
        self.lasso.abort();
        self.rectangle.abort();
        self.grow.abort();
        if let Some((_, progress)) = self.progress() {
            progress.cancel();
        }
        self.held = None;
        was_open
    }

    /// Whether what a gesture shows is to be looked at: the hand rests.
    pub fn rests(&self) -> bool {
        self.grow.is_open() && self.held.is_none()
    }

    /// Whether the wheel is a tool's.
    pub fn takes_wheel(&self) -> bool {
        self.grow.is_open()
    }

    /// Whether the primary button is a tool's.
    pub fn takes_primary(&self) -> bool {
        self.active != Tool::Select
    }

    /// What the dabs of frames took, with their edit, ms.
    pub fn dab_ms(&self) -> &[f64] {
        &self.dab_ms
    }

    /// What the hand can do.
    pub fn hint(&self) -> Option<&'static str> {
        self.active.hint()
    }

    /// Whether an edit is under way that ends by itself.
    pub fn is_busy(&self) -> bool {
        self.work.is_some() || self.grow.is_growing() || self.brush.is_busy() && self.held.is_none()
    }

    /// What there is to say since the last time.
    pub fn take_said(&mut self) -> Option<String> {
        self.said.take()
    }

    /// An edit on a thread, for a bar with its progress.
    pub fn progress(&self) -> Option<(&str, &Progress)> {
        self.work.as_ref().map(Work::progress)
    }

    /// The selection that commands of the menu Selection work on.
    pub fn target(&self, open: &OpenFigure) -> Option<target::Target> {
        let is_there = match &self.settings.target {
            Aim::New => false,
            Aim::Painted(slot) => target::all(open).iter().any(|(known, _)| known == slot),
            Aim::Copy(part) => target::title(open, part).is_some(),
        };
        is_there.then(|| target::Target::of(open, &self.settings.target).ok())?
    }

    /// Begins what a command of the menu Selection does.
    pub fn refine(&mut self, ctx: &Context, command: UiCommand, open: &OpenFigure) {
        if let Some(target) = self.target(open).filter(|_| self.work.is_none()) {
            self.work = work::refine(ctx, command, target, self.settings.refine_mm(open));
        }
    }

    /// The brush grows or shrinks by a tenth.
    pub fn scale_radius(&mut self, open: &OpenFigure, factor: f64) {
        let radius = self.settings.radius_mm(open);
        self.settings.set_radius_mm(open, factor * radius);
    }

    /// Follows what is chosen, and what came of edits on threads.
    pub fn poll(&mut self, open: &mut OpenFigure) {
        self.follow_copies(open);
        let chosen = target::chosen(open);
        if chosen != self.chosen {
            if let Some(aim) = &chosen {
                self.settings.target = aim.clone();
            }
            self.chosen = chosen;
        }
        if let Some(work) = &mut self.work
            && let Some(result) = work.poll(open)
        {
            self.work = None;
            match result {
                Ok(slot) => self.settings.target = Aim::Painted(slot),
                Err(sentence) => self.said = Some(sentence),
            }
        }
    }

    /// Undo takes a copy away: the structure that it was made of is aimed at again, as it was before. Redo brings it back.
    fn follow_copies(&mut self, open: &mut OpenFigure) {
        if let Some(copy) = open.chosen_region().and_then(|part| target::copy(open, part)) {
            open.choose(open.object, Some(copy));
        }
        let Aim::Painted(slot) = &self.settings.target else { return };
        if let Some((object, part)) = target::original(open.document.figure(), slot) {
            self.copied = Some((slot.clone(), object, part));
        } else if !open.document.figure().selections.iter().any(|s| s.name == *slot)
            && let Some((_, object, part)) = self.copied.take().filter(|(copy, ..)| copy == slot)
            && object == open.object
            && target::title(open, &part).is_some()
        {
            open.choose(object, Some(part.clone()));
            self.settings.target = Aim::Copy(part);
        }
    }

    /// Follows the hand: in the figure and in slices, of which `aimed` is what is under the pointer. Whether the brush has painted.
    pub fn follow(&mut self, ui: &Ui, open: &mut OpenFigure, aimed: Option<View>) -> bool {
        if !self.takes_primary() {
            self.held = None;
            return false;
        }
        let hands = self.hands(ui, aimed.as_ref());
        // What is drawn anew during a drag is seen from where it began.
        let view = self.held.clone().or(aimed.clone());
        let before = open.document.figure().clone();
        let shift = ui.input(|i| i.modifiers.shift);
        let begun = Instant::now();
        let (mut said, mut around) = (None, None);
        match self.active {
            Tool::Select => {}
            Tool::Brush => said = self.brush.follow(&hands, view.as_ref(), open, &mut self.settings),
            Tool::Lasso => around = self.lasso.follow(ui, &hands, view.as_ref()).map(|around| (around, "Lasso")),
            Tool::Rectangle => {
                around = self.rectangle.follow(&hands, view.as_ref(), shift).map(|around| (around, "Rectangle"));
            }
            Tool::Grow => match self.grow.follow(ui, &hands, view.as_ref(), open, &mut self.settings) {
                Ok(None) => {}
                Ok(Some(accepted)) => self.settings.target = Aim::Painted(accepted),
                Err(sentence) => said = Some(sentence),
            },
        }
        if let Some((around, verb)) = around {
            said = self.enclose(ui.ctx(), open, around, verb).err();
        }
        if hands.contains(&Hand::Released) {
            self.held = None;
        }
        self.said = said.or(self.said.take());
        let has_changed = !Arc::ptr_eq(&before, open.document.figure());
        if has_changed {
            if self.active == Tool::Brush {
                self.dab_ms.push(1e3 * begun.elapsed().as_secs_f64());
            }
            self.brush.forget_surface();
            self.poll(open);
            ui.ctx().request_repaint();
        }
        if self.brush.is_busy() {
            ui.ctx().request_repaint();
        }
        self.draw(ui, open, view.as_ref());
        has_changed && self.active == Tool::Brush
    }

    /// Begins to select what is in a loop.
    fn enclose(&mut self, ctx: &Context, open: &OpenFigure, around: lasso::Loop, verb: &str) -> Result<(), String> {
        if self.work.is_some() {
            return Err("Another edit is under way".to_owned());
        }
        let target = target::Target::of(open, &self.settings.target)?;
        let limits = self.settings.limits(open, &target.volume, &around.view);
        let depth_mm = self.settings.depth_mm(open);
        let reach = if self.settings.is_surface_only { work::Reach::Surface(depth_mm) } else { work::Reach::Through };
        let mode = self.settings.mode.held(around.shift, around.alt);
        self.work = Some(work::enclose(ctx, target, around, limits, reach, mode, verb));
        Ok(())
    }

    /// What is drawn over the view at the pointer.
    fn draw(&mut self, ui: &Ui, open: &OpenFigure, view: Option<&View>) {
        let Some((view, at)) = view.zip(ui.input(|i| i.pointer.latest_pos())) else { return };
        if !view.rect().contains(at) {
            return;
        }
        let painter = ui.painter_at(view.rect());
        let erases = self.settings.erases() != ui.input(|i| i.modifiers.alt);
        match self.active {
            Tool::Select => {}
            Tool::Brush => {
                ui.ctx().set_cursor_icon(CursorIcon::None);
                self.brush.cursor(&painter, at, view, self.settings.radius_mm(open), erases);
            }
            Tool::Lasso | Tool::Rectangle => {
                ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
                self.lasso.draw(&painter, at);
                self.rectangle.draw(&painter);
            }
            Tool::Grow => {
                ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
                self.grow.draw(&painter, at, self.settings.tolerance(open));
            }
        }
    }

    /// What the hand did with the primary button in this frame, all of its way.
    fn hands(&mut self, ui: &Ui, aimed: Option<&View>) -> Vec<Hand> {
        let space = ui.input(|i| i.key_down(Key::Space));
        let mut hands = Vec::new();
        let events = ui.input(|i| i.events.clone());
        for event in events {
            match event {
                Event::PointerButton { pos, button: PointerButton::Primary, pressed: true, modifiers } => {
                    if let Some(view) = aimed.filter(|view| view.rect().contains(pos))
                        && is_tools(PointerButton::Primary, modifiers, space)
                    {
                        self.held = Some(view.clone());
                        hands.push(Hand::Pressed { at: pos, shift: modifiers.shift, alt: modifiers.alt });
                    }
                }
                Event::PointerButton { button: PointerButton::Primary, pressed: false, .. } if self.held.is_some() => {
                    hands.push(Hand::Released);
                }
                Event::PointerMoved(pos) if self.held.is_some() => hands.push(Hand::Moved(pos)),
                _ => {}
            }
        }
        hands
    }
}

/// A line of text on any background.
pub fn tell(painter: &Painter, at: Pos2, text: &str) {
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), Color32::WHITE);
    let rect = Align2::LEFT_CENTER.anchor_size(at, galley.size());
    // Within the view, even at its edge.
    let room = painter.clip_rect().shrink(8.0);
    let over = Vec2::new((rect.right() - room.right()).max(0.0), (room.top() - rect.top()).max(0.0));
    let rect = rect.translate(Vec2::new(-over.x, over.y));
    painter.rect_filled(rect.expand2(Vec2::new(5.0, 2.0)), 4.0, Color32::from_black_alpha(190));
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// Milliliters as they are told: three digits, or all before the point.
fn shorter_ml(ml: f64) -> String {
    let decimals = (2.0 - ml.max(1e-3).log10().floor()).clamp(0.0, 3.0) as usize;
    format!("{ml:.decimals$}")
}

/// Millimeters as they are told: two digits that say something.
fn shorter_mm(mm: f64) -> String {
    shorter(if mm < 1.0 { (1000.0 * mm).round() / 1000.0 } else { (10.0 * mm).round() / 10.0 })
}
