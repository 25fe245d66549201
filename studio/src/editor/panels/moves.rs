//! Where the chosen region was moved to, the ghost that it leaves, and how it looks where it meets others.

use eframe::egui::{self, ComboBox, Ui};
use glam::{DQuat, DVec3};

use super::super::movable::{Change, Movable, rotation};
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::properties::{number, row};
use super::strength;
use crate::figure::template::{LookTemplate, MeetingTemplate, MoveTemplate, Rgb, SCALES, Tint};

/// What a meeting is drawn in at first: a color that hardly any tissue has.
const MEETING: [u8; 3] = [0xd5, 0x5e, 0x00];

/// The section.
pub fn show(ui: &mut Ui, open: &mut OpenFigure, movable: &Movable, styles: &[&str]) {
    place(ui, open, movable);
    if !movable.is_moved() {
        let text = "Drag the handles in the figure, or type. What is moved leaves a ghost.";
        ui.add(egui::Label::new(theme::small(ui.ctx(), text)).wrap());
        return;
    }
    let back = ui.button("Put back").on_hover_text("To where it was found; its ghost's look is kept");
    if back.clicked() {
        movable.apply(open, Change::Back);
    }
    ui.separator();
    ghost(ui, open, movable, styles);
    ui.separator();
    meeting(ui, open, movable, "Color where it meets its ghost", |moved| &mut moved.meets_ghost);
    meeting(ui, open, movable, "Color where it meets others", |moved| &mut moved.meets_background);
}

fn place(ui: &mut Ui, open: &mut OpenFigure, movable: &Movable) {
    let moved = movable.moved();
    let mut offset_mm = movable.radius_mm * DVec3::from_array(moved.offset);
    for (axis, label) in ["Right", "Anterior", "Superior"].into_iter().enumerate() {
        let before = offset_mm[axis];
        let tooltip = "How far it was moved along this axis of the body; less than 0: the other way";
        let response = number(ui, label, tooltip, &mut offset_mm[axis], " mm", 0.5);
        let by = (offset_mm[axis] - before) * DVec3::AXES[axis];
        let to = format!("{:.1} mm {}", offset_mm[axis], label.to_lowercase());
        open.edit_by(&response, response.changed().then(|| movable.command_to(Change::By(by), "Move", &to)));
    }
    for (axis, label) in ["Turn, right", "Turn, anterior", "Turn, superior"].into_iter().enumerate() {
        let mut turn_deg = DVec3::from_array(moved.turn);
        let tooltip = "Component, along this axis of the body, of the rotation vector: right-handed, about the middle";
        let response = number(ui, label, tooltip, &mut turn_deg[axis], "°", 0.5);
        // What turns it from where it is to there.
        let by = DQuat::from_mat3(&(rotation(turn_deg) * moved.rotation().transpose())).to_scaled_axis();
        let by = DVec3::from_array(by.to_array().map(f64::to_degrees));
        let to = format!("{:.1}°", turn_deg.length());
        open.edit_by(&response, response.changed().then(|| movable.command_to(Change::Turn(by), "Turn", &to)));
    }
    let mut scale = moved.scale;
    let response = number(ui, "Scale", "Factor of its size, 0.01 to 100", &mut scale, " ×", 0.005);
    let factor = scale.clamp(SCALES.0, SCALES.1) / moved.scale;
    let to = format!("{:.2}", moved.scale * factor);
    open.edit_by(&response, response.changed().then(|| movable.command_to(Change::Scale(factor), "Scale", &to)));
}

fn ghost(ui: &mut Ui, open: &mut OpenFigure, movable: &Movable, styles: &[&str]) {
    let Some(region) = open.chosen().and_then(|o| o.regions.get(movable.region)) else { return };
    let look = region.look_at(movable.parts[0].structure.as_deref());
    let (own, shown) = (movable.moved().ghost.clone(), movable.moved().ghost_of(&look));
    let set = |change: &dyn Fn(LookTemplate) -> LookTemplate| {
        movable.with("Change ghost", &|moved| MoveTemplate { ghost: change(moved.ghost.clone()), ..moved })
    };
    let mut visible = shown.visible.unwrap_or(true);
    let check = ui.checkbox(&mut visible, "Ghost").on_hover_text("Whether the place that it left shows it still");
    if check.changed() {
        let visible = (visible != look.visible.unwrap_or(true)).then_some(visible);
        open.edit(set(&|own| LookTemplate { visible, ..own }));
    }
    if !visible {
        return;
    }
    let mut percent = 100.0 * shown.opacity.unwrap_or(1.0);
    let response = number(ui, "Ghost opacity", "Factor of its opacity", &mut percent, " %", 0.5);
    let opacity = Some((percent / 100.0).clamp(0.0, 1.0));
    open.edit_by(&response, response.changed().then(|| set(&|own| LookTemplate { opacity, ..own })));
    row(ui, "Ghost color", "A color in place of the styles' own, lit as they are", |ui, label| {
        let text = |tint: Option<Tint>| match tint {
            None => "As the region",
            Some(Tint::None) => "The style's",
            Some(Tint::Own) => "The label map's",
            Some(Tint::Color(_)) => "This one",
        };
        let color = match own.tint {
            Some(Tint::Color(color)) => color,
            _ => [128; 3],
        };
        let combo = ComboBox::from_id_salt("ghost tint").selected_text(text(own.tint)).show_ui(ui, |ui| {
            for choice in [None, Some(Tint::None), Some(Tint::Color(color))] {
                if ui.selectable_label(choice == own.tint, text(choice)).clicked() {
                    open.edit(set(&|own| LookTemplate { tint: choice, ..own }));
                }
            }
        });
        combo.response.accessible_name(label);
        if let Some(Tint::Color(mut color)) = own.tint {
            let response = ui.color_edit_button_srgb(&mut color).accessible_name("Color of the ghost");
            if response.changed() {
                open.edit(set(&|own| LookTemplate { tint: Some(Tint::Color(color)), ..own }));
            }
        }
    });
    row(ui, "Ghost style", "The style that takes the place of all of its own", |ui, label| {
        let selected = own.style.as_deref().unwrap_or("As the region");
        let combo = ComboBox::from_id_salt("ghost style").selected_text(selected).show_ui(ui, |ui| {
            for (style, text) in std::iter::once((None, "As the region")).chain(styles.iter().map(|s| (Some(*s), *s))) {
                if ui.selectable_label(own.style.as_deref() == style, text).clicked() {
                    open.edit(set(&|own| LookTemplate { style: style.map(str::to_owned), ..own }));
                }
            }
        });
        combo.response.accessible_name(label);
    });
}

type Meets = fn(&mut MoveTemplate) -> &mut Option<MeetingTemplate>;

fn meeting(ui: &mut Ui, open: &mut OpenFigure, movable: &Movable, title: &str, of: Meets) {
    let found = of(&mut movable.moved().clone()).clone();
    let set = |meeting: Option<MeetingTemplate>| {
        movable.with("Change meeting", &|mut moved| {
            of(&mut moved).clone_from(&meeting);
            moved
        })
    };
    ui.horizontal(|ui| {
        let mut is_on = found.is_some();
        let tooltip = "A color of its own where both overlap; without, both are seen";
        if ui.checkbox(&mut is_on, title).on_hover_text(tooltip).changed() {
            open.edit(set(is_on.then(|| MeetingTemplate::new(MEETING))));
        }
        if let Some(meeting) = &found {
            let mut color = meeting.color.0;
            let response = ui.color_edit_button_srgb(&mut color).accessible_name(format!("{title}: color"));
            if response.changed() {
                open.edit(set(Some(MeetingTemplate { color: Rgb(color), ..meeting.clone() })));
            }
            let mut is_own = meeting.opacity.is_some();
            let tooltip = "An opacity of its own; without, that of the denser of the two";
            if ui.checkbox(&mut is_own, "Opacity").on_hover_text(tooltip).changed() {
                open.edit(set(Some(MeetingTemplate { opacity: is_own.then_some(1.0), ..meeting.clone() })));
            }
            if let Some(mut opacity) = meeting.opacity {
                let slider = egui::DragValue::new(&mut opacity).range(0.0..=1.0).speed(0.01).max_decimals(2);
                if ui.add(slider).accessible_name(format!("{title}: opacity")).changed() {
                    open.edit(set(Some(MeetingTemplate { opacity: Some(opacity), ..meeting.clone() })));
                }
            }
        }
    });
    if let Some(meeting) = found {
        egui::CollapsingHeader::new("By the values that meet").id_salt(title).show(ui, |ui| {
            strength::edit(ui, open, title, meeting.strength.as_ref(), &|strength| {
                set(Some(MeetingTemplate { strength, ..meeting.clone() }))
            });
        });
    }
}
