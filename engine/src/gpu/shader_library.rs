//! Shader texts: the modules under `shaders/`, and the one resolver that puts together what a pipeline key needs.
//!
//! `#import bind/frame` pulls a module in once; `#import {sampling}` names a choice that the key makes; lines between
//! `#if colors` and `#end` are there for keys with that feature. A feature that the scene lacks is not in the text, so it
//! costs nothing.

use std::collections::HashSet;
use std::fmt::Write;

macro_rules! modules {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../shaders/", $name, ".wgsl")))),*]
    };
}

/// Every module: (name, text).
pub const MODULES: &[(&str, &str)] = modules![
    "bind/bodies",
    "bind/colors",
    "bind/coverage",
    "bind/frame",
    "bind/functions",
    "bind/lighting",
    "bind/object",
    "bind/parts",
    "bind/patterns",
    "bind/regions",
    "bind/rows",
    "bind/resume",
    "bind/validity",
    "lib/bodies_few",
    "lib/bodies_many",
    "lib/bodies_most",
    "lib/composite",
    "lib/contour",
    "lib/covered",
    "lib/cut_face",
    "lib/cut_face_labels",
    "lib/drawn",
    "lib/face",
    "lib/fullscreen",
    "lib/function_one",
    "lib/functions",
    "lib/gradient",
    "lib/gradient_color",
    "lib/gradient_sampled",
    "lib/gradient_texel",
    "lib/label",
    "lib/light_map",
    "lib/light_model",
    "lib/looks",
    "lib/meeting",
    "lib/modulated",
    "lib/nodes",
    "lib/opacity",
    "lib/part",
    "lib/pattern",
    "lib/pose_moved",
    "lib/pose_part",
    "lib/pose_rest",
    "lib/pose_shifted",
    "lib/principal",
    "lib/ray",
    "lib/region",
    "lib/rows",
    "lib/resume_none",
    "lib/sample_filtered",
    "lib/sample_loads",
    "lib/seen_color",
    "lib/seen_label",
    "lib/seen_one",
    "lib/seen_regions",
    "lib/seen_tints",
    "lib/shade_lit",
    "lib/shade_style",
    "lib/skip",
    "lib/stretch",
    "lib/strongest_change",
    "lib/style",
    "lib/table_filtered",
    "lib/table_loads",
    "lib/through",
    "lib/through_shifted",
    "lib/through_turned",
    "lib/tint",
    "lib/transfer_function",
    "lib/turned",
    "lib/validity_all",
    "lib/wall",
    "lib/whole_looks",
    "raycast",
    "raycast_bodies",
];

/// What a raycast pipeline is made for. Equal keys have equal text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RaycastKey {
    /// The adapter filters the volume's format; otherwise eight loads do.
    pub filtered: bool,
    /// The adapter filters f32, in which the transfer function's table is kept; otherwise four loads do.
    pub table_filtered: bool,
    /// The volume has voxels that are no number.
    pub no_data: bool,
    /// The volume is one of colors.
    pub colors: bool,
    /// They have alpha; never without `colors`.
    pub alpha: bool,
    /// Gradients are differences of samples, not texels; never with `colors`, of which they always are.
    pub sampled_gradients: bool,
    /// The object has regions with looks of their own.
    pub regions: bool,
    /// Their borders are found by two look-ups of labels in place of memberships; never without `regions`.
    pub labels: bool,
    /// Their looks have several functions from value to opacity, or styles; never without `regions`.
    pub functions: bool,
    /// Some of these have a second coordinate; never without `functions`.
    pub rows: bool,
    /// Some regions are more opaque than others, so that where they end there is a face; never without `regions`.
    pub cuts: bool,
    /// Some regions were moved, or parts overlap, so that there are several bodies; never without `regions`, and always with `cuts`.
    pub bodies: bool,
    /// More than [`FEW_BODIES`]; never without `bodies`.
    pub many_bodies: bool,
    /// There are intersection transfer functions; never without `bodies`.
    pub meetings: bool,
    /// The object is cut into parts; with `bodies` where some of these overlap, or something else was moved as well.
    pub parts: bool,
    /// Some of these were not only shifted; never without `parts`, nor with `bodies`.
    pub turned: bool,
    /// What shows may reach the faces of the volume; always with `bodies`.
    pub faces: bool,
    /// Contours are drawn.
    pub contours: bool,
    /// Opacity is modulated as in eq. 3.2.
    pub transparency: bool,
    /// Lights take the place of styles' own.
    pub lit: bool,
    /// What they do is in a map, not a formula; never without `lit`.
    pub lighting_map: bool,
    /// There is more than one; never without `lit`.
    pub several_lights: bool,
    /// Styles carry patterns.
    pub patterns: bool,
    /// Some of which follow the curvature of surfaces; never without `patterns`.
    pub curvature: bool,
    /// The pass goes on where another one had to stop; always with `bodies`, of which hardly any ray is done in one.
    pub resumed: bool,
}

/// Bodies that a pipeline takes which is not for many.
pub const FEW_BODIES: usize = 4;

impl std::fmt::Display for RaycastKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.filtered { "raycast filtered" } else { "raycast loads" })?;
        f.write_str(if self.table_filtered { "" } else { " table_loads" })?;
        f.write_str(if self.no_data { " no_data" } else { "" })?;
        f.write_str(if self.colors { " colors" } else { "" })?;
        f.write_str(if self.alpha { " alpha" } else { "" })?;
        f.write_str(if self.sampled_gradients { " sampled_gradients" } else { "" })?;
        f.write_str(if self.regions { " regions" } else { "" })?;
        f.write_str(if self.labels { " labels" } else { "" })?;
        f.write_str(if self.functions { " functions" } else { "" })?;
        f.write_str(if self.rows { " rows" } else { "" })?;
        f.write_str(if self.cuts { " cuts" } else { "" })?;
        f.write_str(if self.bodies { " bodies" } else { "" })?;
        f.write_str(if self.many_bodies { " many" } else { "" })?;
        f.write_str(if self.meetings { " meetings" } else { "" })?;
        f.write_str(if self.parts { " parts" } else { "" })?;
        f.write_str(if self.turned { " turned" } else { "" })?;
        f.write_str(if self.faces { "" } else { " no_faces" })?;
        f.write_str(if self.contours { " contours" } else { "" })?;
        f.write_str(if self.transparency { " transparency" } else { "" })?;
        f.write_str(if self.lit { " lit" } else { "" })?;
        f.write_str(if self.lighting_map { " map" } else { "" })?;
        f.write_str(if self.several_lights { " lights" } else { "" })?;
        f.write_str(if self.patterns { " patterns" } else { "" })?;
        f.write_str(if self.curvature { " curvature" } else { "" })?;
        f.write_str(if self.resumed { " resumed" } else { "" })
    }
}

impl RaycastKey {
    /// Keys for tests: every combination of what there is, but contours, transparency, lights and patterns, which are there one at a
    /// time or all together, where the adapter filters and all voxels have data; with labels all or none; with rows where the adapter
    /// filters, all voxels have data, and contours and lights are both there or not; with parts likewise; gradients as differences of
    /// samples with no more than regions, parts, and contours, transparency and lights together; without faces likewise, but with neither faces
    /// of regions nor bodies; parts both turned and only shifted.
    pub fn all() -> impl Iterator<Item = Self> {
        // Each of these with regions by memberships, then by labels.
        // No regions; regions with one function and several; the same with faces; with bodies; with meetings; with many bodies and
        // with both.
        let all = [0, 1, 2, 4, 7, 8, 31].into_iter().flat_map(|drawn| (0..13 * 48).map(move |n| (drawn, n)));
        let all = all.filter(|(drawn, n)| *drawn == 0 || n & 7 == 0);
        let all = all.map(|(drawn, n)| Self {
            contours: drawn & 1 != 0,
            transparency: drawn & 2 != 0,
            lit: drawn & 4 != 0,
            lighting_map: drawn == 7 || drawn == 31,
            several_lights: drawn == 31,
            patterns: drawn & 8 != 0,
            curvature: drawn & 16 != 0,
            filtered: n & 1 == 0,
            table_filtered: n & 2 == 0,
            no_data: n & 4 != 0,
            resumed: n & 8 != 0,
            colors: n % 48 >= 16,
            alpha: n % 48 >= 32,
            sampled_gradients: false,
            regions: n >= 48,
            labels: false,
            functions: (n / 48) % 2 == 0 && n >= 48,
            rows: false,
            cuts: n >= 3 * 48,
            bodies: n >= 5 * 48,
            many_bodies: n >= 9 * 48,
            meetings: (7 * 48..9 * 48).contains(&n) || n >= 11 * 48,
            parts: false,
            turned: false,
            faces: true,
        });
        let all = all.filter(|key| key.resumed || !key.bodies);
        let with_labels =
            |key: &Self| key.regions && [key.transparency, key.lit].iter().all(|has| *has == key.contours);
        let all = all.flat_map(move |key| {
            let labeled = Some(Self { labels: true, ..key }).filter(with_labels);
            std::iter::once(key).chain(labeled)
        });
        let with_rows = |key: &Self| key.functions && key.filtered && !key.no_data && key.contours == key.lit;
        let all = all.flat_map(move |key| {
            let rowed = Some(Self { rows: true, ..key }).filter(|key| with_rows(key) && key.table_filtered);
            std::iter::once(key).chain(rowed)
        });
        let with_parts = |key: &Self| {
            !key.meetings
                && key.filtered
                && key.table_filtered
                && !key.no_data
                && key.contours == key.lit
                && key.lit == key.patterns
        };
        let all =
            all.flat_map(move |key| std::iter::once(key).chain(Some(Self { parts: true, ..key }).filter(with_parts)));
        let all = all.flat_map(move |key| {
            std::iter::once(key).chain(Some(Self { turned: true, ..key }).filter(|key| key.parts && !key.bodies))
        });
        let with_samples = |key: &Self| {
            let is_plain =
                !key.no_data && !key.labels && !key.rows && !key.meetings && !key.patterns && key.table_filtered;
            !key.colors && is_plain && key.contours == key.lit && key.transparency == key.contours
        };
        let all = all.flat_map(move |key| {
            std::iter::once(key).chain(Some(Self { sampled_gradients: true, ..key }).filter(with_samples))
        });
        let without_faces = move |key: &Self| with_samples(key) && !key.bodies && !key.cuts && !key.sampled_gradients;
        all.flat_map(move |key| std::iter::once(key).chain(Some(Self { faces: false, ..key }).filter(without_faces)))
    }

    /// Whether rays walk through one body that is not cut up.
    pub fn is_whole(self) -> bool {
        !self.bodies && !self.parts
    }

    /// The WGSL text for this key.
    ///
    /// # Errors
    /// The name of a module that is imported and missing (a programming error that tests catch).
    pub fn wgsl(self) -> Result<String, String> {
        let choose = |choice: &str| match choice {
            "sampling" => Some(if self.filtered { "lib/sample_filtered" } else { "lib/sample_loads" }),
            "table" => Some(if self.table_filtered { "lib/table_filtered" } else { "lib/table_loads" }),
            "no_data" => Some(if self.no_data { "bind/validity" } else { "lib/validity_all" }),
            "light" => Some(if self.lighting_map { "lib/light_map" } else { "lib/light_model" }),
            "gradient_source" if self.sampled_gradients => Some("lib/gradient_sampled"),
            "gradient_source" => Some("lib/gradient_texel"),
            "gradient" => Some(if self.colors { "lib/gradient_color" } else { "lib/gradient" }),
            "function" => Some(if self.functions { "lib/functions" } else { "lib/function_one" }),
            "seen" if self.labels => Some("lib/seen_label"),
            "seen" if self.functions => Some("lib/seen_regions"),
            "seen" => Some(if self.regions { "lib/seen_tints" } else { "lib/seen_one" }),
            "shade" => Some(if self.lit { "lib/shade_lit" } else { "lib/shade_style" }),
            "pose" if self.bodies => Some("lib/pose_moved"),
            "pose" if self.parts && !self.turned => Some("lib/pose_shifted"),
            "through" => Some(if self.turned { "lib/through_turned" } else { "lib/through_shifted" }),
            "pose" => Some(if self.parts { "lib/pose_part" } else { "lib/pose_rest" }),
            "bodies" if self.parts && self.many_bodies => Some("lib/bodies_most"),
            "bodies" => Some(if self.many_bodies { "lib/bodies_many" } else { "lib/bodies_few" }),
            "resume" => Some(if self.resumed { "bind/resume" } else { "lib/resume_none" }),
            _ => None,
        };
        let has = |feature: &str| match feature {
            "colors" => Some(self.colors),
            "alpha" => Some(self.alpha),
            "regions" => Some(self.regions),
            "labels" => Some(self.labels),
            "functions" => Some(self.functions),
            "plain_functions" => Some(self.functions && !self.rows),
            "no_functions" => Some(!self.functions),
            "rows" => Some(self.rows),
            "cuts" => Some(self.cuts),
            "meetings" => Some(self.meetings),
            "parts" => Some(self.parts),
            "faces" => Some(self.faces),
            "bodies" => Some(self.bodies),
            "contours" => Some(self.contours),
            "transparency" => Some(self.transparency),
            "lit" => Some(self.lit),
            "several_lights" => Some(self.several_lights),
            "only_lit" => Some(self.lit && !self.patterns),
            "neither_lit_nor_patterns" => Some(!self.lit && !self.patterns),
            "patterns" => Some(self.patterns),
            "curvature" => Some(self.curvature),
            _ => None,
        };
        assemble(if self.bodies { "raycast_bodies" } else { "raycast" }, &choose, &has)
    }
}

/// Puts an entry module and everything it imports into one text, each module once, imports first. Lines between `#if feature`
/// and `#else` or `#end` are in the text if `has` the feature, those between `#else` and `#end` if not.
///
/// # Errors
/// The name of an import or feature that does not exist, or a module whose `#if` does not end.
pub fn assemble(
    entry: &str,
    choose: &dyn Fn(&str) -> Option<&'static str>,
    has: &dyn Fn(&str) -> Option<bool>,
) -> Result<String, String> {
    let (mut text, mut seen) = (String::new(), HashSet::new());
    add(entry, choose, has, &mut seen, &mut text)?;
    Ok(text)
}

fn add(
    name: &str,
    choose: &dyn Fn(&str) -> Option<&'static str>,
    has: &dyn Fn(&str) -> Option<bool>,
    seen: &mut HashSet<String>,
    text: &mut String,
) -> Result<(), String> {
    if !seen.insert(name.to_owned()) {
        return Ok(());
    }
    let module = MODULES.iter().find(|(n, _)| *n == name).ok_or_else(|| format!("no shader module \"{name}\""))?.1;
    let mut body = String::new();
    // Whether lines are left out, within an `#if`.
    let mut left_out = None;
    for line in module.lines() {
        if let Some(feature) = line.strip_prefix("#if ").map(str::trim) {
            let has = has(feature).ok_or_else(|| format!("no feature \"{feature}\" in \"{name}\""))?;
            if left_out.replace(!has).is_some() {
                return Err(format!("an #if within another in \"{name}\""));
            }
        } else if line.trim_end() == "#else" {
            left_out = Some(!left_out.ok_or_else(|| format!("an #else without #if in \"{name}\""))?);
        } else if line.trim_end() == "#end" {
            left_out.take().ok_or_else(|| format!("an #end without #if in \"{name}\""))?;
        } else if left_out == Some(true) {
            continue;
        } else if let Some(import) = line.strip_prefix("#import ").map(str::trim) {
            let target = match import.strip_prefix('{').and_then(|i| i.strip_suffix('}')) {
                None => import,
                Some(choice) => choose(choice).ok_or_else(|| format!("no choice for {{{choice}}} in \"{name}\""))?,
            };
            add(target, choose, has, seen, text)?;
        } else {
            body.push_str(line);
            body.push('\n');
        }
    }
    if left_out.is_some() {
        return Err(format!("an #if without #end in \"{name}\""));
    }
    // Writing to a String cannot fail.
    let _ = writeln!(text, "// ---- {name} ----\n{body}");
    Ok(())
}
