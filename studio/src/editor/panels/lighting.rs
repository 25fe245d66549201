//! Lights of the chosen object: which model, and a ball on which they are dragged.

use eframe::egui::{
    Button, Color32, ColorImage, ComboBox, CornerRadius, Pos2, Rect, Role, Sense, Stroke, StrokeKind, TextureHandle,
    TextureOptions, Ui, Vec2, WidgetInfo,
};
use fabrica_engine::color::srgb8_from_linear;
use fabrica_engine::scene::lighting::MAX_LIGHTS;
use fabrica_engine::scene::{Camera, Lighting, Projection};
use glam::DVec3;

use super::super::open_figure::OpenFigure;
use super::properties::{number, row};
use crate::figure::Command;
use crate::figure::template::{
    CameraTemplate, FixedTo, LightTemplate, LightingModel, LightingTemplate, MAX_BRIGHTNESS, MAX_SHININESS, Rgb,
};

/// Side of the ball, in points, and of its picture, in pixels.
const BALL: f32 = 104.0;
const BALL_PIXELS: usize = 104;
/// How far out, in half sides of the square, a light can be dragged.
const MOST_BEHIND: f64 = 0.97;
/// Radius of a light's dot, and how near the pointer takes it.
const DOT: f32 = 5.0;
const NEAR: f32 = 12.0;

/// The rows.
pub fn show(ui: &mut Ui, open: &mut OpenFigure) {
    let Some(lighting) = open.chosen().map(|object| object.lighting.clone()) else { return };
    let object = open.object;
    let set = |lighting: Option<LightingTemplate>| Command::SetLighting { object, lighting };
    let tooltip = "What lights surfaces: the styles' own light, or lights, to which styles only give their color";
    row(ui, "Light", tooltip, |ui, label| {
        let text = |model: Option<LightingModel>| match model {
            None => "The styles' own",
            Some(LightingModel::BlinnPhong) => "Blinn-Phong",
            Some(LightingModel::Cartoon) => "Cartoon",
            Some(LightingModel::Metal) => "Metal",
            Some(LightingModel::Unshaded) => "Unshaded",
        };
        let shown = lighting.as_ref().map(|l| l.model);
        let combo = ComboBox::from_id_salt("lighting").selected_text(text(shown)).show_ui(ui, |ui| {
            use LightingModel::{BlinnPhong, Cartoon, Metal, Unshaded};
            for choice in [None, Some(BlinnPhong), Some(Cartoon), Some(Metal), Some(Unshaded)] {
                if ui.selectable_label(choice == shown, text(choice)).clicked() {
                    let lit = |model| match &lighting {
                        Some(old) => LightingTemplate { model, ..old.clone() },
                        None => LightingTemplate::new(model),
                    };
                    open.edit(set(choice.map(lit)));
                }
            }
        });
        combo.response.accessible_name(label).on_hover_text(tooltip);
    });
    let Some(lighting) = lighting else { return };
    if lighting.model == LightingModel::BlinnPhong {
        terms(ui, open, &lighting);
    }
    if lighting.model != LightingModel::Unshaded {
        lights(ui, open, &lighting);
    }
}

/// A number of a lighting.
type Field = fn(&mut LightingTemplate) -> &mut f64;

fn terms(ui: &mut Ui, open: &mut OpenFigure, lighting: &LightingTemplate) {
    let mut changed = lighting.clone();
    let object = open.object;
    let rows: [(&str, &str, Field, f64); 4] = [
        ("Ambient", "How much of the surface's color there is without any light", |l| &mut l.ambient, 0.005),
        ("Diffuse", "How much of the surface's color light brings out", |l| &mut l.diffuse, 0.005),
        ("Specular", "How much of the light itself is seen in highlights", |l| &mut l.specular, 0.005),
        ("Shininess", "Exponent of the highlights: large ones are small and sharp", |l| &mut l.shininess, 0.2),
    ];
    for (label, tooltip, field, speed) in rows {
        let response = number(ui, label, tooltip, field(&mut changed), "", speed);
        let value = field(&mut changed);
        *value = if label == "Shininess" { value.clamp(1.0, MAX_SHININESS) } else { value.clamp(0.0, 1.0) };
        let command = Command::SetLighting { object, lighting: Some(changed.clone()) };
        open.edit_by(&response, response.changed().then_some(command));
    }
}

/// The ball with a dot for each light, and the numbers of the one that was touched last.
fn lights(ui: &mut Ui, open: &mut OpenFigure, lighting: &LightingTemplate) {
    let id = ui.scope_id().with("light");
    let Some(camera) = seen_by(&open.document.figure().camera) else { return };
    let mut chosen = ui.data(|d| d.get_temp::<usize>(id)).unwrap_or(0).min(lighting.lights.len() - 1);
    let object = open.object;
    let with = |light: LightTemplate, chosen: usize| {
        let mut changed = lighting.clone();
        changed.lights[chosen] = light;
        Command::SetLighting { object, lighting: Some(changed) }
    };
    ui.horizontal(|ui| {
        let (rect, response) = ui.allocate_exact_size(Vec2::splat(BALL), Sense::click_and_drag());
        let response =
            response.on_hover_text("Drag a dot: where the light comes from. Behind the rim it is behind the object");
        response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, "Lights"));
        paint(ui, rect, lighting, &camera, chosen);
        let dots: Vec<Pos2> = lighting.lights.iter().map(|l| dot(rect, in_view(l, &camera))).collect();
        if let Some(at) = response.interact_pointer_pos() {
            if response.drag_started() || response.clicked() {
                let near = (0..dots.len()).min_by(|a, b| dots[*a].distance(at).total_cmp(&dots[*b].distance(at)));
                chosen = near.filter(|i| dots[*i].distance(at) < NEAR || response.drag_started()).unwrap_or(chosen);
                ui.data_mut(|d| d.insert_temp(id, chosen));
            }
            let light = &lighting.lights[chosen];
            let from = out_of_view(direction(rect, at), light.fixed_to, &camera);
            let moved = LightTemplate { from: from.map(|x| (x * 1e4).round() / 1e4), ..light.clone() };
            open.edit_by(&response, (response.dragged() || response.clicked()).then(|| with(moved, chosen)));
        } else {
            open.edit_by(&response, None);
        }
        ui.vertical(|ui| {
            let can_add = lighting.lights.len() < MAX_LIGHTS;
            if ui.add_enabled(can_add, Button::new("Add light")).clicked() {
                let mut changed = lighting.clone();
                let light = LightTemplate { brightness: 0.4, ..LightTemplate::from([0.8, -0.2, 0.5]) };
                changed.lights.push(light);
                ui.data_mut(|d| d.insert_temp(id, changed.lights.len() - 1));
                open.edit(Command::SetLighting { object, lighting: Some(changed) });
            }
            let can_remove = lighting.lights.len() > 1;
            if ui.add_enabled(can_remove, Button::new("Remove light")).clicked() {
                let mut changed = lighting.clone();
                changed.lights.remove(chosen);
                open.edit(Command::SetLighting { object, lighting: Some(changed) });
            }
            let light = &lighting.lights[chosen];
            let mut color = light.color.0;
            if ui.color_edit_button_srgb(&mut color).accessible_name("Light color").changed() {
                open.edit(with(LightTemplate { color: Rgb(color), ..light.clone() }, chosen));
            }
        });
    });
    let light = &lighting.lights[chosen];
    let mut brightness = light.brightness;
    let response = number(ui, "Brightness", "Factor of the chosen light's color", &mut brightness, "", 0.01);
    let brighter = LightTemplate { brightness: brightness.clamp(0.0, MAX_BRIGHTNESS), ..light.clone() };
    open.edit_by(&response, response.changed().then(|| with(brighter, chosen)));
    row(ui, "Fixed to", "Whether it stays in the picture or turns with the object", |ui, _| {
        for (fixed_to, text) in [(FixedTo::Camera, "Picture"), (FixedTo::Object, "Object")] {
            if ui.selectable_label(light.fixed_to == fixed_to, text).clicked() {
                // It goes on shining from where it does.
                let from = out_of_view(in_view(light, &camera), fixed_to, &camera);
                open.edit(with(LightTemplate { from, fixed_to, ..light.clone() }, chosen));
            }
        }
    });
}

/// A camera that looks as the figure's does: lights know nothing of where it is.
fn seen_by(camera: &CameraTemplate) -> Option<Camera> {
    let from = DVec3::from_array(camera.from);
    Camera::looking(from, -from, DVec3::from_array(camera.up), Projection::Orthographic { height_mm: 1.0 }).ok()
}

/// Unit direction towards a light: right, up, towards the eye.
fn in_view(light: &LightTemplate, camera: &Camera) -> DVec3 {
    let d = DVec3::from_array(light.from).normalize_or(DVec3::Z);
    match light.fixed_to {
        FixedTo::Camera => d,
        FixedTo::Object => DVec3::new(d.dot(camera.right), d.dot(camera.up), -d.dot(camera.forward)),
    }
}

/// The inverse of [`in_view`].
fn out_of_view(d: DVec3, fixed_to: FixedTo, camera: &Camera) -> [f64; 3] {
    match fixed_to {
        FixedTo::Camera => d.to_array(),
        FixedTo::Object => (d.x * camera.right + d.y * camera.up - d.z * camera.forward).to_array(),
    }
}

/// Where a direction is on the ball: the half towards the eye takes the inner 70 % of the radius, the other the rest.
fn dot(rect: Rect, d: DVec3) -> Pos2 {
    let angle = d.z.clamp(-1.0, 1.0).acos() / std::f64::consts::PI;
    // Straight from behind there is no way around the ball: above it, as good as any.
    let across = glam::DVec2::new(d.x, d.y).normalize_or(glam::DVec2::Y);
    let r = if angle <= 0.5 { 1.4 * angle } else { 0.7 + 0.6 * (angle - 0.5) };
    rect.center() + 0.5 * rect.width() * Vec2::new((r * across.x) as f32, -(r * across.y) as f32)
}

/// The inverse of [`dot`].
fn direction(rect: Rect, at: Pos2) -> DVec3 {
    let v = (at - rect.center()) / (0.5 * rect.width());
    let (x, y) = (f64::from(v.x), -f64::from(v.y));
    // Never straight from behind: that is everywhere on the rim.
    let r = x.hypot(y).min(MOST_BEHIND);
    let angle = std::f64::consts::PI * if r <= 0.7 { r / 1.4 } else { 0.5 + (r - 0.7) / 0.6 };
    let across = glam::DVec2::new(x, y).normalize_or_zero();
    DVec3::new(across.x * angle.sin(), across.y * angle.sin(), angle.cos())
}

fn paint(ui: &Ui, rect: Rect, lighting: &LightingTemplate, camera: &Camera, chosen: usize) {
    let id = ui.scope_id().with("lit ball");
    let lit = lighting.lighting();
    let known = ui.data(|d| d.get_temp::<(LightingTemplate, DVec3, TextureHandle)>(id));
    let texture = match known {
        Some((l, forward, texture)) if l == *lighting && forward == camera.forward => texture,
        _ => {
            let texture = ui.ctx().load_texture("lit ball", picture(&lit, camera), TextureOptions::LINEAR);
            ui.data_mut(|d| d.insert_temp(id, (lighting.clone(), camera.forward, texture.clone())));
            texture
        }
    };
    let painter = ui.painter_at(rect.expand(DOT));
    let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
    painter.image(texture.id(), rect, whole, Color32::WHITE);
    for (i, light) in lighting.lights.iter().enumerate() {
        let at = dot(rect, in_view(light, camera));
        let [r, g, b] = light.color.0;
        painter.circle_filled(at, DOT, Color32::from_rgb(r, g, b));
        let line = if i == chosen { ui.visuals().selection.stroke.color } else { Color32::BLACK };
        painter.circle_stroke(at, DOT, Stroke::new(if i == chosen { 2.0 } else { 1.0 }, line));
    }
    painter.rect_stroke(rect, CornerRadius::ZERO, Stroke::new(1.0, ui.visuals().weak_text_color()), StrokeKind::Inside);
}

/// A clay ball in this light.
fn picture(lighting: &Lighting, camera: &Camera) -> ColorImage {
    const CLAY: DVec3 = DVec3::new(0.55, 0.52, 0.48);
    let size = BALL_PIXELS;
    let pixel = |i: usize| {
        let at = |k: usize| (k as f64 + 0.5) / size as f64 * 2.0 - 1.0;
        // The ball has the inner 70 % of the square; lights behind it are dragged around it.
        let (x, y) = (at(i % size) / 0.7, -at(i / size) / 0.7);
        if x.hypot(y) > 1.0 {
            return Color32::TRANSPARENT;
        }
        let n = DVec3::new(x, y, (1.0 - x * x - y * y).sqrt());
        let [r, g, b] = lighting.on_sphere(camera, CLAY, n).to_array().map(|c| srgb8_from_linear(c as f32));
        Color32::from_rgb(r, g, b)
    };
    ColorImage::new([size, size], (0..size * size).map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dot_is_where_its_light_comes_from() {
        let rect = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::splat(BALL));
        for d in [DVec3::new(0.3, -0.2, 0.9), DVec3::new(-0.6, 0.7, 0.1), DVec3::new(0.5, 0.4, -0.7)] {
            let d = d.normalize();
            assert!(direction(rect, dot(rect, d)).distance(d) < 1e-4, "{d}");
        }
        assert!(direction(rect, rect.center()).distance(DVec3::Z) < 1e-9);
        // Beyond the square: behind.
        let behind = direction(rect, rect.right_top() + Vec2::new(50.0, -50.0));
        assert!(behind.z < -0.98 && behind.x > 0.0 && behind.y > 0.0, "{behind}");
        assert!(dot(rect, behind).distance(rect.center()) > 0.45 * BALL);
        assert!(rect.contains(dot(rect, DVec3::NEG_Z)));
    }
}
