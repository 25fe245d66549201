//! The regions of an object: selected parts with looks of their own, and in a group each of its structures.

use std::sync::Arc;

use eframe::egui::collapsing_header::CollapsingState;
use eframe::egui::{
    self, Align, ComboBox, EventFilter, Id, Key, Layout, Modifiers, Rect, Response, ScrollArea, Sense, Stroke,
    StrokeKind, Ui, UiBuilder, Vec2,
};
use fabrica_engine::selection::Structure;

use super::super::gallery::DraggedStyle;
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::super::tools::target as tools_target;
use super::objects::draw_eye;
use super::properties::{number, parse_number, row, shorter};
use crate::figure::Command;
use crate::figure::bridge::drawn;
use crate::figure::command::{Chosen, FunctionOf, function_at};
use crate::figure::sources::Selections;
use crate::figure::template::{IMPORTANCE, LookTemplate, ObjectTemplate, RegionTemplate, RestTemplate, Tint};

/// From so many structures on, one types what one looks for.
const SEARCHED: usize = 8;
/// Heights of a row, and of what is between two.
const ROW: f32 = 26.0;
const GAP: f32 = 2.0;
/// Width of the choice of an order.
const ORDER: f32 = 92.0;

/// In which order a group's structures are listed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Order {
    /// As in their file.
    #[default]
    File,
    Name,
    /// The largest first.
    Volume,
    /// What matters most first.
    Importance,
}

impl Order {
    fn text(self) -> &'static str {
        match self {
            Self::File => "As in file",
            Self::Name => "By name",
            Self::Volume => "By volume",
            Self::Importance => "By importance",
        }
    }

    fn sort(self, region: &RegionTemplate, structures: &mut [&Structure]) {
        let importance = |s: &Structure| region.importance_of(Some(&region.called(&s.label)));
        match self {
            Self::Importance => structures.sort_by(|a, b| importance(b).total_cmp(&importance(a))),
            Self::File => {}
            Self::Name => structures.sort_by_cached_key(|s| natural(&s.label.name)),
            Self::Volume => structures.sort_by(|a, b| b.selection.num_voxels().total_cmp(&a.selection.num_voxels())),
        }
    }
}

/// What names are sorted by: numbers in them as numbers, so that the second rib comes before the tenth.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = vec![(String::new(), 0u64)];
    let mut in_number = false;
    for c in name.to_lowercase().chars() {
        match (c.to_digit(10), in_number, parts.last_mut()) {
            (Some(digit), _, Some((_, number))) => {
                *number = number.saturating_mul(10).saturating_add(digit.into());
                in_number = true;
            }
            (None, false, Some((text, _))) => text.push(c),
            (None, ..) => {
                parts.push((c.to_string(), 0));
                in_number = false;
            }
            (Some(_), _, None) => {}
        }
    }
    parts
}

/// The regions of an object, below its row; lists of structures are at most `list_height` points high.
pub fn list(ui: &mut Ui, open: &mut OpenFigure, object: usize, list_height: f32) {
    let figure = open.document.figure().clone();
    let template = &figure.objects[object];
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = GAP;
        for (i, region) in template.regions.iter().enumerate() {
            let selections = open.structures_of(region).cloned();
            if region.structure.is_none() {
                group(ui, open, (object, i, region), selections.as_ref(), list_height);
                continue;
            }
            let found = selections.as_ref().and_then(|s| drawn(region, &s.structures).next());
            ui.indent(("region", i), |ui| {
                let part = Chosen { region: i, structure: None };
                let about = found.map_or(String::new(), |s| in_ml(s.selection.volume_ml()));
                let about = with_importance(about, region.importance_of(None), Order::File);
                let row = Row { object, region, part, title: region.title(), structure: found, about };
                let response = row.show(ui, open);
                row.choose_by(ui, open, &response, &[]);
            });
        }
        if !template.regions.is_empty() {
            rest(ui, open, object, template);
        }
    });
}

/// A group: its own row, and once it is unfolded those of its structures.
fn group(
    ui: &mut Ui,
    open: &mut OpenFigure,
    (object, index, region): (usize, usize, &RegionTemplate),
    selections: Option<&Arc<Selections>>,
    list_height: f32,
) {
    let id = ui.make_persistent_id(("group", object, index));
    let reveals = open.reveals_region
        && open.object == object
        && open.chosen_region().is_some_and(|c| c.region == index && c.structure.is_some());
    let mut state = CollapsingState::load_with_default_open(ui.ctx(), id, true);
    if reveals && !state.is_open() {
        state.set_open(true);
    }
    let count = selections.map_or(0, |s| drawn(region, &s.structures).count());
    let header = state.show_header(ui, |ui| {
        let part = Chosen { region: index, structure: None };
        let about = selections.map_or_else(|| "reading…".to_owned(), |_| count.to_string());
        let about = with_importance(about, region.importance_of(None), Order::File);
        let row = Row { object, region, part, title: region.title(), structure: None, about };
        let response = row.show(ui, open);
        row.choose_by(ui, open, &response, &[]);
    });
    header.body(|ui| {
        let Some(selections) = selections else { return };
        if selections.structures.is_empty() {
            let why = selections.notes.first().map_or("There are no structures in it.", String::as_str);
            ui.add(egui::Label::new(theme::small(ui.ctx(), why)).wrap());
            return;
        }
        let listed = listed(ui, open, (object, index, region), selections, id, reveals);
        if listed.is_empty() {
            ui.label(theme::small(ui.ctx(), "None is called so."));
            return;
        }
        let order: Order = ui.data(|d| d.get_temp(id.with("order"))).unwrap_or_default();
        rows(ui, open, (object, index, region), &listed, order, (id, list_height, reveals));
    });
}

/// The structures that are to be listed, in their order; above them what decides it.
fn listed<'a>(
    ui: &mut Ui,
    open: &mut OpenFigure,
    (object, index, region): (usize, usize, &RegionTemplate),
    selections: &'a Selections,
    id: Id,
    reveals: bool,
) -> Vec<&'a Structure> {
    let (search_id, order_id) = (id.with("search"), id.with("order"));
    let mut wanted: String = ui.data(|d| d.get_temp(search_id)).unwrap_or_default();
    let mut order: Order = ui.data(|d| d.get_temp(order_id)).unwrap_or_default();
    // What was copied to be painted on has a row of its own.
    let all: Vec<&Structure> = drawn(region, &selections.structures).collect();
    let count = all.len();
    if count > SEARCHED {
        let hidden = |s: &&Structure| !matches(s, &wanted) && open.is_chosen(object, &part_of(index, region, s));
        if reveals && all.iter().any(hidden) {
            wanted.clear();
        }
        ui.horizontal(|ui| {
            let width = ui.available_width() - ORDER - ui.spacing().item_spacing.x;
            let field = theme::text_field(&mut wanted).hint_text("Search").desired_width(width - 16.0);
            let field = ui.add(field).accessible_name(format!("Search in {}", region.title()));
            if field.lost_focus() && ui.input(|i| i.key_pressed(Key::Escape)) {
                wanted.clear();
            }
            let combo = ComboBox::from_id_salt(order_id).selected_text(order.text()).width(ORDER).truncate();
            let combo = combo.show_ui(ui, |ui| {
                for choice in [Order::File, Order::Name, Order::Volume, Order::Importance] {
                    ui.selectable_value(&mut order, choice, choice.text());
                }
            });
            combo.response.accessible_name(format!("Order in {}", region.title()));
        });
        ui.data_mut(|d| {
            d.insert_temp(search_id, wanted.clone());
            d.insert_temp(order_id, order);
        });
    }
    let mut listed: Vec<&Structure> = all.into_iter().filter(|s| matches(s, &wanted)).collect();
    order.sort(region, &mut listed);
    if count > 1 {
        ui.horizontal(|ui| {
            let names = || listed.iter().map(|s| region.called(&s.label)).collect::<Vec<_>>();
            for (text, tooltip, visible) in
                [("Show all", "Show all that are listed", true), ("Hide all", "Hide all that are listed", false)]
            {
                if ui.small_button(text).on_hover_text(tooltip).clicked() {
                    let change = |own: LookTemplate| with_visible(own, &region.look, visible);
                    open.edit(changed(object, index, region, &names(), change));
                }
            }
            let chosen = open.chosen_structures().count();
            let text = match (listed.len(), chosen) {
                (_, 2..) if open.chosen_region().is_some_and(|c| c.region == index) => format!("{chosen} chosen"),
                (n, _) if n < count => format!("{n} of {count}"),
                _ => String::new(),
            };
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.label(theme::small(ui.ctx(), text)));
        });
    }
    listed
}

/// The rows of a group's structures.
fn rows(
    ui: &mut Ui,
    open: &mut OpenFigure,
    (object, index, region): (usize, usize, &RegionTemplate),
    listed: &[&Structure],
    order: Order,
    (id, list_height, reveals): (Id, f32, bool),
) {
    let parts: Vec<Chosen> = listed.iter().map(|s| part_of(index, region, s)).collect();
    // What is below does not jump while one types.
    let shrinks = open.structures_of(region).is_none_or(|s| s.structures.len() <= SEARCHED);
    let area = ScrollArea::vertical().id_salt(id.with("list")).max_height(list_height);
    let mut area = area.auto_shrink([false, shrinks]);
    let offset_id = id.with("offset");
    // What an arrow key goes to, or what is chosen.
    let focused: Option<Chosen> = ui.data(|d| d.get_temp(focus_id()));
    let revealed = focused.as_ref().or(open.chosen_region());
    if reveals && let Some(place) = parts.iter().position(|part| revealed == Some(part)) {
        let (offset, height): (f32, f32) = ui.data(|d| d.get_temp(offset_id)).unwrap_or((0.0, list_height));
        // No further than it takes.
        let top = place as f32 * (ROW + GAP);
        let (least, most) = ((top + 2.0 * ROW - height).max(0.0), (top - ROW).max(0.0));
        area = area.vertical_scroll_offset(offset.clamp(least.min(most), most));
    }
    let shown = area.show_rows(ui, ROW, listed.len(), |ui, range| {
        for i in range {
            let (part, title) = (parts[i].clone(), &listed[i].label.name);
            let importance = region.importance_of(part.structure.as_deref());
            let about = with_importance(in_ml(listed[i].selection.volume_ml()), importance, order);
            let row = Row { object, region, part, title, structure: Some(listed[i]), about };
            let response = row.show(ui, open);
            row.choose_by(ui, open, &response, &parts);
        }
    });
    ui.data_mut(|d| d.insert_temp(offset_id, (shown.state.unclamped_offset().y, shown.inner_rect.height())));
}

/// What stands at the right of a row: how important it is, where that says something.
fn with_importance(about: String, importance: f64, order: Order) -> String {
    match importance {
        i if order == Order::Importance => format!("importance {}", shorter(i)),
        IMPORTANCE => about,
        i if about.is_empty() => format!("imp. {}", shorter(i)),
        i => format!("imp. {}, {about}", shorter(i)),
    }
}

fn part_of(index: usize, region: &RegionTemplate, structure: &Structure) -> Chosen {
    Chosen { region: index, structure: Some(region.called(&structure.label)) }
}

fn matches(structure: &Structure, wanted: &str) -> bool {
    let name = structure.label.name.to_lowercase();
    wanted.split_whitespace().all(|word| name.contains(&word.to_lowercase()))
}

/// The edit that changes what is said of what is chosen: a region, or structures in it. None where that is an object.
pub(super) fn change_chosen(open: &OpenFigure, change: impl Fn(LookTemplate) -> LookTemplate) -> Option<Command> {
    let index = open.chosen_region()?.region;
    let region = open.chosen()?.regions.get(index)?;
    let names: Vec<String> = open.chosen_structures().cloned().collect();
    Some(changed(open.object, index, region, &names, change))
}

/// The edit that changes what is said of a region itself (no names), or of structures in it.
fn changed(
    object: usize,
    index: usize,
    region: &RegionTemplate,
    names: &[String],
    change: impl Fn(LookTemplate) -> LookTemplate,
) -> Command {
    let look = |name: Option<&str>| change(region.own_look(name));
    match names {
        [] => Command::SetLook { object, region: index, structure: None, look: look(None) },
        [name] => Command::SetLook { object, region: index, structure: Some(name.clone()), look: look(Some(name)) },
        names => {
            let looks = names.iter().map(|name| (name.clone(), look(Some(name)))).collect();
            Command::SetLooks { object, region: index, looks }
        }
    }
}

/// The look, visible or not, without saying what its group says anyway.
fn with_visible(look: LookTemplate, group: &LookTemplate, visible: bool) -> LookTemplate {
    LookTemplate { visible: (visible != group.visible.unwrap_or(true)).then_some(visible), ..look }
}

/// What color a look has, if not its style's.
fn color_of(look: &LookTemplate, region: &RegionTemplate, structure: Option<&Structure>) -> Option<[u8; 3]> {
    match look.tint.unwrap_or(if region.structure.is_none() { Tint::Own } else { Tint::None }) {
        Tint::Own => structure.map(|s| s.label.color),
        Tint::Color(color) => Some(color),
        Tint::None => None,
    }
}

/// A row: eye, color, name, and what there is of it.
struct Row<'a> {
    object: usize,
    region: &'a RegionTemplate,
    part: Chosen,
    title: &'a str,
    structure: Option<&'a Structure>,
    /// What stands at the right: its volume, or how many there are.
    about: String,
}

impl Row<'_> {
    fn show(&self, ui: &mut Ui, open: &mut OpenFigure) -> Response {
        let tokens = theme::tokens(ui.ctx());
        let look = self.region.look_at(self.part.structure.as_deref());
        let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
        if open.is_chosen(self.object, &self.part) {
            ui.painter().rect_filled(rect, 4.0, tokens.selected);
        }
        let inside = UiBuilder::new()
            .id_salt(("row", &self.part.structure, self.part.region))
            .max_rect(rect.shrink2(Vec2::new(4.0, 0.0)))
            .layout(Layout::left_to_right(Align::Center));
        let response = ui.scope_builder(inside, |ui| self.contents(ui, open, &look)).inner;
        self.take_style(ui, open, rect);
        // The row that an arrow key has gone to.
        if ui.data(|d| d.get_temp::<Chosen>(focus_id())).as_ref() == Some(&self.part) && open.object == self.object {
            response.request_focus();
            ui.data_mut(|d| d.remove_temp::<Chosen>(focus_id()));
        }
        response
    }

    fn contents(&self, ui: &mut Ui, open: &mut OpenFigure, look: &LookTemplate) -> Response {
        let tokens = theme::tokens(ui.ctx());
        let visible = look.visible.unwrap_or(true);
        if draw_eye(ui, &format!("{} {}", if visible { "Hide" } else { "Show" }, self.title), visible) {
            let around = if self.part.structure.is_some() { self.region.look.clone() } else { LookTemplate::default() };
            let change = |own: LookTemplate| with_visible(own, &around, !visible);
            open.edit(changed(self.object, self.part.region, self.region, &self.names(open), change));
        }
        let (dot, _) = ui.allocate_exact_size(Vec2::splat(14.0), Sense::hover());
        match color_of(look, self.region, self.structure) {
            Some([r, g, b]) => ui.painter().circle_filled(dot.center(), 6.0, egui::Color32::from_rgb(r, g, b)),
            None => ui.painter().circle_stroke(dot.center(), 6.0, Stroke::new(1.0, tokens.dim)),
        };
        let is_empty = self.structure.is_some_and(|s| s.selection.is_empty());
        let text = egui::RichText::new(self.title);
        let is_dim = !visible || is_empty;
        let button = egui::Button::new(if is_dim { text.color(tokens.dim) } else { text })
            .frame(false)
            .right_text(theme::small(ui.ctx(), &self.about))
            .min_size(Vec2::new(ui.available_width(), ROW))
            .truncate();
        let response = ui.add(button).accessible_name(self.title);
        let response = if is_empty { response.on_hover_text("None of it is in this volume") } else { response };
        response.context_menu(|ui| self.menu(ui, open));
        response
    }

    /// What an edit of this row is about: itself, or all that are chosen together with it.
    fn names(&self, open: &OpenFigure) -> Vec<String> {
        let together: Vec<String> = open.chosen_structures().cloned().collect();
        match &self.part.structure {
            Some(_) if together.len() > 1 && open.is_chosen(self.object, &self.part) => together,
            structure => structure.iter().cloned().collect(),
        }
    }

    fn menu(&self, ui: &mut Ui, open: &mut OpenFigure) {
        let (object, region) = (self.object, self.part.region);
        if self.part.structure.is_some() && ui.button("Show only this").clicked() {
            let names = self.names(open);
            open.edit(show_only(open, object, region, self.region, &names));
            ui.close();
        }
        if self.part.structure.is_none() && ui.button("Remove region").clicked() {
            open.choose(object, None);
            open.edit(Command::RemoveRegion { object, region });
            ui.close();
        }
    }

    /// A click chooses; with Ctrl as well, with Shift all `listed` up to here, with both those as well. Arrows go to the next one, with
    /// Shift as well; Ctrl+A chooses all.
    fn choose_by(&self, ui: &Ui, open: &mut OpenFigure, response: &Response, listed: &[Chosen]) {
        let place = |part: &Chosen| listed.iter().position(|other| other == part);
        let anchor = open.anchor().filter(|_| open.object == self.object).and_then(|part| place(&part));
        let names = |a: usize, b: usize| {
            let range = listed[a.min(b)..=a.max(b)].iter();
            range.filter_map(|part| part.structure.clone()).collect::<Vec<_>>()
        };
        if response.clicked() {
            // Arrows go on from here.
            response.request_focus();
            let modifiers = ui.input(|i| i.modifiers);
            match (place(&self.part), anchor, &self.part.structure) {
                (Some(here), Some(anchor), _) if modifiers.shift => {
                    open.choose_range(names(anchor, here), modifiers.command);
                }
                (Some(_), Some(_), Some(structure)) if modifiers.command => open.choose_too(structure),
                _ => open.choose(self.object, Some(self.part.clone())),
            }
        }
        if !response.has_focus() {
            return;
        }
        let filter = EventFilter { vertical_arrows: true, ..EventFilter::default() };
        ui.memory_mut(|m| m.set_focus_lock_filter(response.id, filter));
        let Some(here) = place(&self.part) else { return };
        let by = |modifiers, key| ui.input_mut(|i| i.consume_key(modifiers, key));
        if by(Modifiers::COMMAND, Key::A) {
            open.choose_range(names(0, listed.len() - 1), true);
            return;
        }
        let extends = ui.input(|i| i.modifiers.shift);
        let modifiers = if extends { Modifiers::SHIFT } else { Modifiers::NONE };
        let next = match (by(modifiers, Key::ArrowDown), by(modifiers, Key::ArrowUp)) {
            (true, false) => here + 1,
            (false, true) => here.wrapping_sub(1),
            _ => return,
        };
        if let Some(part) = listed.get(next) {
            match anchor.filter(|_| extends) {
                Some(anchor) => open.choose_range(names(anchor, next), false),
                None => open.choose(self.object, Some(part.clone())),
            }
            let next = part;
            open.reveals_region = true;
            ui.memory_mut(|m| m.data.insert_temp(focus_id(), next.clone()));
        }
    }

    /// A style that falls on the row dresses what it stands for.
    fn take_style(&self, ui: &Ui, open: &mut OpenFigure, rect: Rect) {
        let carried = egui::DragAndDrop::payload::<DraggedStyle>(ui.ctx());
        let over = carried.is_some() && ui.rect_contains_pointer(rect);
        if over || (open.aimed.as_ref() == Some(&(self.object, self.part.clone()))) {
            let accent = theme::tokens(ui.ctx()).accent;
            ui.painter().rect_stroke(rect, 4.0, Stroke::new(2.0, accent), StrokeKind::Inside);
        }
        if over
            && ui.input(|i| i.pointer.any_released())
            && let Some(style) = egui::DragAndDrop::take_payload::<DraggedStyle>(ui.ctx())
        {
            dress(open, self.object, &self.part, &style.0);
        }
    }
}

/// Where the row is remembered that shall have the focus once it is there.
fn focus_id() -> Id {
    Id::unique("region with focus")
}

/// Dresses a region or a structure: its own transfer function where it has one, else its look.
pub fn dress(open: &mut OpenFigure, object: usize, part: &Chosen, style: &str) {
    let figure = open.document.figure();
    let Some(region) = figure.objects.get(object).and_then(|o| o.regions.get(part.region)) else { return };
    let own = region.own_look(part.structure.as_deref());
    let of = FunctionOf { object, part: Some(part.clone()), row: 0 };
    let command = match (own.transfer_function.is_some(), function_at(figure, &of)) {
        (true, Some(mut function)) => {
            function.all_nodes_mut().for_each(|node| node.style = style.to_owned());
            Command::SetRows { of, function, label: format!("Dress in {style}") }
        }
        _ => Command::SetLook {
            object,
            region: part.region,
            structure: part.structure.clone(),
            look: LookTemplate { style: Some(style.to_owned()), ..own },
        },
    };
    open.edit(command);
}

/// All others of a group are hidden.
fn show_only(open: &OpenFigure, object: usize, index: usize, region: &RegionTemplate, only: &[String]) -> Command {
    let structures = open.structures_of(region).map_or(&[][..], |s| &s.structures);
    let look = |structure: &Structure| {
        let name = region.called(&structure.label);
        let look = with_visible(region.own_look(Some(&name)), &region.look, only.contains(&name));
        (name, look)
    };
    Command::SetLooks { object, region: index, looks: structures.iter().map(look).collect() }
}

/// What is in no region.
fn rest(ui: &mut Ui, open: &mut OpenFigure, object: usize, template: &ObjectTemplate) {
    ui.indent("rest", |ui| {
        let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
        let inside = rect.shrink2(Vec2::new(4.0, 0.0));
        let inside = UiBuilder::new().max_rect(inside).layout(Layout::left_to_right(Align::Center));
        ui.scope_builder(inside, |ui| {
            let rest = &template.rest;
            let visible = rest.visible;
            if draw_eye(ui, if visible { "Hide the rest" } else { "Show the rest" }, visible) {
                open.edit(Command::SetRest { object, rest: RestTemplate { visible: !visible, ..rest.clone() } });
            }
            ui.add_space(14.0 + ui.spacing().item_spacing.x);
            let text = egui::RichText::new("The rest");
            let text = if visible { text } else { text.color(theme::tokens(ui.ctx()).dim) };
            ui.label(text).on_hover_text("What belongs to no region of this object");
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let mut percent = 100.0 * rest.opacity;
                let field = egui::DragValue::new(&mut percent).speed(0.5).range(0.0..=100.0).suffix(" %");
                let field = field.max_decimals(1).update_while_editing(false).custom_parser(parse_number);
                let response = ui.add(field).accessible_name("Opacity of the rest");
                let response = response.on_hover_text("Factor of the opacity of what belongs to no region");
                let rest = RestTemplate { opacity: (percent / 100.0).clamp(0.0, 1.0), ..rest.clone() };
                open.edit_by(&response, response.changed().then_some(Command::SetRest { object, rest }));
            });
        });
    });
}

fn in_ml(ml: f64) -> String {
    match ml {
        0.0 => "none".to_owned(),
        m if m >= 99.5 => format!("{m:.0} ml"),
        m if m >= 0.95 => format!("{m:.1} ml"),
        m if m >= 0.001 => format!("{m:.3} ml"),
        _ => "< 0.001 ml".to_owned(),
    }
}

/// How the chosen region or structures look.
pub fn look(ui: &mut Ui, open: &mut OpenFigure, styles: &[&str]) {
    let Some(Chosen { region: index, structure }) = open.chosen_region().cloned() else { return };
    let object = open.object;
    let Some(region) = open.chosen().and_then(|o| o.regions.get(index)).cloned() else { return };
    let names: Vec<String> = open.chosen_structures().cloned().collect();
    let own = region.own_look(structure.as_deref());
    let look = region.look_at(structure.as_deref());
    let set = |change: &dyn Fn(LookTemplate) -> LookTemplate| changed(object, index, &region, &names, change);
    let title = match names.len() {
        0 => region.title().to_owned(),
        1 => names[0].clone(),
        n => format!("{n} structures"),
    };
    ui.add(egui::Label::new(title).truncate());
    let mut percent = 100.0 * look.opacity.unwrap_or(1.0);
    let response = number(ui, "Opacity", "Factor of its opacity; 0 cuts it out", &mut percent, " %", 0.5);
    let opacity = Some((percent / 100.0).clamp(0.0, 1.0));
    let command = response.changed().then(|| set(&|own| LookTemplate { opacity, ..own }));
    open.edit_by(&response, command);
    let is_group = region.structure.is_none();
    let tint = look.tint.unwrap_or(if is_group { Tint::Own } else { Tint::None });
    row(ui, "Color", "A color in place of the styles' own, lit as they are", |ui, label| {
        let text = |tint: Tint| match tint {
            Tint::None => "The style's",
            Tint::Own => "The label map's",
            Tint::Color(_) => "This one",
        };
        let color = match tint {
            Tint::Color(color) => color,
            _ => [230, 159, 0],
        };
        let combo = ComboBox::from_id_salt("tint").selected_text(text(tint)).show_ui(ui, |ui| {
            for choice in [Tint::Own, Tint::None, Tint::Color(color)] {
                if ui.selectable_label(choice == tint, text(choice)).clicked() {
                    open.edit(set(&|own| LookTemplate { tint: Some(choice), ..own }));
                }
            }
        });
        combo.response.accessible_name(label);
        if let Tint::Color(mut color) = tint {
            let response = ui.color_edit_button_srgb(&mut color).accessible_name("Region color");
            if response.changed() {
                open.edit(set(&|own| LookTemplate { tint: Some(Tint::Color(color)), ..own }));
            }
        }
    });
    row(ui, "Style", "The style that takes the place of all of the transfer function's", |ui, label| {
        let shown = look.style.as_deref().unwrap_or("As the nodes");
        let combo = ComboBox::from_id_salt("region style").selected_text(shown).show_ui(ui, |ui| {
            let mut choose = |ui: &mut Ui, style: Option<&str>, text: &str| {
                if ui.selectable_label(look.style.as_deref() == style, text).clicked() {
                    open.edit(set(&|own| LookTemplate { style: style.map(str::to_owned), ..own }));
                }
            };
            choose(ui, None, "As the nodes");
            for style in styles {
                choose(ui, Some(style), style);
            }
        });
        combo.response.accessible_name(label);
    });
    importance(ui, open, &region, &names);
    ui.horizontal_wrapped(|ui| {
        let differs = names.iter().any(|name| !region.own_look(Some(name)).is_default()) || !own.is_default();
        if ui.add_enabled(differs, egui::Button::new("Look like its surroundings")).clicked() {
            open.edit(set(&|_| LookTemplate::default()));
        }
        if names.is_empty() {
            let original = tools_target::original(open.document.figure(), &region.selection);
            let tooltip = match original.and_then(|(_, part)| part.structure) {
                Some(name) => format!("{name} is drawn as its file has it again"),
                None => "Its voxels belong to the object again".to_owned(),
            };
            let remove = ui.button("Remove region").on_hover_text(tooltip);
            if remove.clicked() {
                open.choose(object, None);
                open.edit(Command::RemoveRegion { object, region: index });
            }
        } else {
            let text = if names.len() == 1 { "Show only this" } else { "Show only these" };
            if ui.button(text).on_hover_text("Hides all others of its group").clicked() {
                open.edit(show_only(open, object, index, &region, &names));
            }
        }
    });
}

/// How important the chosen region is, or all structures that are chosen.
fn importance(ui: &mut Ui, open: &mut OpenFigure, region: &RegionTemplate, names: &[String]) {
    let Some(Chosen { region: index, structure }) = open.chosen_region().cloned() else { return };
    let object = open.object;
    let mut value = region.importance_of(structure.as_deref());
    let is_set = match names {
        [] => region.importance.is_some(),
        names => region.structures.iter().any(|s| s.importance.is_some() && names.contains(&s.structure)),
    };
    let tooltip = "How much it matters to what the figure tells: 1 as usual, 0 not at all. It is kept with the figure and sorts the \
                   list; nothing is drawn by it yet";
    let set = |importance| Command::SetImportance { object, region: index, structures: names.to_vec(), importance };
    row(ui, "Importance", tooltip, |ui, label| {
        let slider = egui::Slider::new(&mut value, 0.0..=10.0).clamping(egui::SliderClamping::Never).max_decimals(2);
        let slider = slider.custom_parser(parse_number).update_while_editing(false);
        let response = ui.add(slider).accessible_name(label).on_hover_text(tooltip);
        let command = response.changed().then(|| set(Some(value.max(0.0))));
        open.edit_by(&response, command);
        response.context_menu(|ui| {
            if ui.add_enabled(is_set, egui::Button::new("Reset")).clicked() {
                open.edit(set(None));
                ui.close();
            }
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["rib 10", "Rib 2", "aorta", "rib 1 right", "rib 1"];
        names.sort_by_cached_key(|name| natural(name));
        assert_eq!(names, ["aorta", "rib 1", "rib 1 right", "Rib 2", "rib 10"]);
    }

    #[test]
    fn volumes_are_said_as_exactly_as_they_are_known() {
        for (ml, text) in
            [(0.0, "none"), (1e-5, "< 0.001 ml"), (0.027, "0.027 ml"), (3.42, "3.4 ml"), (1532.4, "1532 ml")]
        {
            assert_eq!(in_ml(ml), text);
        }
    }
}
