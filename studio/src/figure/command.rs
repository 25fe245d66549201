//! What an edit of a figure is: a value that says everything about it. A document is changed by commands only, so that every
//! change has a name, can be undone, and is the same whether it comes from a panel, a key or a test.

use std::ops::Range;

use anyhow::{Result, bail};

use super::template::{
    Background, CameraTemplate, NodeTemplate, Page, ProjectionName, QualityName, Template, TransferFunctionTemplate,
    VolumeSlot,
};

/// One edit. Objects, nodes and volume slots are named by their position.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// The figure's title.
    SetTitle(String),
    /// The view.
    SetCamera(CameraTemplate),
    /// Central or parallel projection.
    SetProjection(ProjectionName),
    /// What lies behind.
    SetBackground(Background),
    /// Size and resolution on the page.
    SetPage(Page),
    /// Accuracy of the export.
    SetQuality(QualityName),
    /// The whole transfer function of an object: an automatic look, a preset.
    SetTransferFunction {
        /// Which object.
        object: usize,
        /// The new one.
        function: TransferFunctionTemplate,
    },
    /// A new node, put where its position belongs; beside others at the same position after them.
    InsertNode {
        /// Of which object's transfer function.
        object: usize,
        /// The new one.
        node: NodeTemplate,
    },
    /// Position and opacity of a node. It stays between its neighbors: a position beyond them is moved to theirs.
    MoveNode {
        /// Of which object's transfer function.
        object: usize,
        /// Which node.
        node: usize,
        /// Data value or percentile.
        at: f64,
        /// 0 to 1; beyond that it is moved to the nearer of the two.
        opacity: f64,
    },
    /// The style of successive nodes.
    SetStyle {
        /// Of which object's transfer function.
        object: usize,
        /// Which nodes.
        nodes: Range<usize>,
        /// The style's name.
        style: String,
    },
    /// Takes a node away; the last one stays.
    RemoveNode {
        /// Of which object's transfer function.
        object: usize,
        /// Which node.
        node: usize,
    },
    /// σ of the gradients' smoothing; `None`: one voxel.
    SetGradientScale {
        /// Of which object.
        object: usize,
        /// In mm.
        scale_mm: Option<f64>,
    },
    /// d₀: the length that the opacities are stated for; `None`: the volume's smallest spacing.
    SetReferenceLength {
        /// Of which object's transfer function.
        object: usize,
        /// In mm.
        length_mm: Option<f64>,
    },
    /// What an object is called.
    SetName {
        /// Which object.
        object: usize,
        /// Empty: as its volume.
        name: String,
    },
    /// Whether an object is drawn.
    SetVisible {
        /// Which object.
        object: usize,
        /// Drawn or not.
        visible: bool,
    },
    /// Another file in a slot.
    SetVolume {
        /// Which slot.
        slot: usize,
        /// What is in it now.
        volume: VolumeSlot,
    },
}

impl Command {
    /// What the edit of `figure` is called in the list of undo steps: verb, object, amount.
    pub fn label(&self, figure: &Template) -> String {
        match self {
            Self::SetTitle(_) => "Change title".to_owned(),
            Self::SetCamera(_) => "Move view".to_owned(),
            Self::SetProjection(ProjectionName::Perspective) => "Use perspective".to_owned(),
            Self::SetProjection(ProjectionName::Orthographic) => "Use parallel projection".to_owned(),
            Self::SetBackground(_) => "Change background".to_owned(),
            Self::SetPage(page) => format!("Change page to {} x {} mm", short(page.width_mm), short(page.height_mm)),
            Self::SetQuality(_) => "Change quality".to_owned(),
            Self::SetTransferFunction { .. } => "Replace transfer function".to_owned(),
            Self::InsertNode { node, .. } => format!("Insert node at {}", short(node.at)),
            Self::MoveNode { at, .. } => format!("Move node to {}", short(*at)),
            Self::SetStyle { style, .. } => format!("Dress in {style}"),
            Self::RemoveNode { .. } => "Remove node".to_owned(),
            Self::SetGradientScale { .. } => "Change gradient smoothing".to_owned(),
            Self::SetReferenceLength { .. } => "Change reference length of opacity".to_owned(),
            Self::SetName { name, .. } => format!("Rename to {name}"),
            Self::SetVisible { visible: true, .. } => "Show object".to_owned(),
            Self::SetVisible { visible: false, .. } => "Hide object".to_owned(),
            Self::SetVolume { slot, volume } => reading(figure.volumes.get(*slot), volume),
        }
    }

    /// Whether two successive edits of this kind are one undo step: views are, so that undo never wades through them,
    /// and what is typed letter by letter or found by trying.
    pub fn merges_with(&self, later: &Self) -> bool {
        use Background::Color;
        matches!(
            (self, later),
            (Self::SetCamera(_), Self::SetCamera(_))
                | (Self::SetTitle(_), Self::SetTitle(_))
                | (Self::SetBackground(Color(_)), Self::SetBackground(Color(_)))
        )
    }

    /// Makes the edit.
    ///
    /// # Errors
    /// One sentence where it has no meaning; the figure is then what it was.
    pub fn apply(self, figure: &mut Template) -> Result<()> {
        let before = figure.clone();
        let outcome = self.change(figure).and_then(|()| figure.check());
        if outcome.is_err() {
            *figure = before;
        }
        outcome
    }

    fn change(self, figure: &mut Template) -> Result<()> {
        match self {
            Self::SetTitle(title) => figure.title = title,
            Self::SetCamera(camera) => {
                let numbers = [camera.from, camera.up, camera.target].concat();
                if numbers.iter().chain([&camera.fov_deg, &camera.height]).any(|n| !n.is_finite()) {
                    bail!("the view has a number that is not finite; give another one");
                }
                figure.camera = camera;
            }
            Self::SetProjection(projection) => figure.camera.projection = projection,
            Self::SetBackground(background) => figure.background = background,
            Self::SetPage(page) => figure.figure = page,
            Self::SetQuality(quality) => figure.quality = quality,
            Self::SetTransferFunction { object, function } => *function_of(figure, object)? = function,
            Self::InsertNode { object, node } => {
                let nodes = &mut function_of(figure, object)?.nodes;
                let place = nodes.partition_point(|n| n.at <= node.at);
                nodes.insert(place, node);
            }
            Self::MoveNode { object, node, at, opacity } => {
                if !(at.is_finite() && opacity.is_finite()) {
                    bail!("a node cannot be at {at} with opacity {opacity}; give finite numbers");
                }
                let nodes = &mut function_of(figure, object)?.nodes;
                let low = node.checked_sub(1).and_then(|i| nodes.get(i)).map_or(f64::NEG_INFINITY, |n| n.at);
                let high = nodes.get(node + 1).map_or(f64::INFINITY, |n| n.at);
                let node = node_of(nodes, node)?;
                (node.at, node.opacity) = (at.clamp(low, high), opacity.clamp(0.0, 1.0));
            }
            Self::SetStyle { object, nodes, style } => {
                let all = &mut function_of(figure, object)?.nodes;
                let num_nodes = all.len();
                let Some(chosen) = all.get_mut(nodes.clone()).filter(|c| !c.is_empty()) else {
                    bail!("the transfer function has {num_nodes} nodes, not {} to {}", nodes.start + 1, nodes.end);
                };
                for node in chosen {
                    node.style.clone_from(&style);
                }
            }
            Self::RemoveNode { object, node } => {
                let nodes = &mut function_of(figure, object)?.nodes;
                node_of(nodes, node)?;
                if nodes.len() == 1 {
                    bail!("a transfer function needs one node at least; make its opacity 0 instead");
                }
                nodes.remove(node);
            }
            Self::SetGradientScale { object, scale_mm } => {
                if scale_mm.is_some_and(|s| !(s.is_finite() && s >= 0.0)) {
                    bail!("gradients cannot be smoothed by {} mm; give 0 or more", scale_mm.unwrap_or_default());
                }
                object_of(figure, object)?.gradient_scale_mm = scale_mm;
            }
            Self::SetReferenceLength { object, length_mm } => {
                if length_mm.is_some_and(|l| !(l.is_finite() && l > 0.0)) {
                    bail!("opacities cannot be those of {} mm; give a positive length", length_mm.unwrap_or_default());
                }
                function_of(figure, object)?.reference_length_mm = length_mm;
            }
            Self::SetName { object, name } => object_of(figure, object)?.name = name,
            Self::SetVisible { object, visible } => object_of(figure, object)?.visible = visible,
            Self::SetVolume { slot, volume } => match figure.volumes.get_mut(slot) {
                Some(place) => *place = volume,
                None => bail!("the figure has no volume number {}", slot + 1),
            },
        }
        Ok(())
    }
}

/// What a slot's next volume is: another file, or the same with what is read otherwise.
fn reading(before: Option<&VolumeSlot>, now: &VolumeSlot) -> String {
    let name = now.file.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or(&now.file);
    let Some(before) = before.filter(|before| before.file == now.file) else { return format!("Use {name}") };
    let mut parts = vec![format!("Read {name}")];
    if before.raw != now.raw {
        parts.extend(now.raw.as_ref().map(|layout| format!("as {layout}")));
    }
    if before.series != now.series {
        parts.push(now.series.as_ref().map_or_else(|| "any series".to_owned(), |series| format!("series {series}")));
    }
    if before.frame != now.frame {
        parts.push(format!("frame {}", now.frame + 1));
    }
    if before.labels != now.labels {
        parts.push(if now.labels { "as structures" } else { "as values of a scan" }.to_owned());
    }
    match (before.crop, now.crop) {
        (before, now) if before == now => {}
        (None, _) => parts.push("cropped".to_owned()),
        (Some(_), Some(_)) => parts.push("cropped otherwise".to_owned()),
        (Some(_), None) => parts.push("whole".to_owned()),
    }
    let (old, new) = (before.reduce.unwrap_or([1; 3]), now.reduce.unwrap_or([1; 3]));
    if old != new {
        parts.push(match new {
            [1, 1, 1] => "at full resolution".to_owned(),
            [2, 2, 2] => "at half resolution".to_owned(),
            [x, y, z] if x == y && y == z => format!("at 1/{x} of the resolution"),
            [x, y, z] => format!("reduced {x} x {y} x {z}"),
        });
    }
    parts.join(", ")
}

/// At most two decimals, none that say nothing.
fn short(number: f64) -> f64 {
    (100.0 * number).round() / 100.0
}

fn object_of(figure: &mut Template, object: usize) -> Result<&mut super::template::ObjectTemplate> {
    match figure.objects.get_mut(object) {
        Some(found) => Ok(found),
        None => bail!("the figure has no object number {}", object + 1),
    }
}

fn function_of(figure: &mut Template, object: usize) -> Result<&mut TransferFunctionTemplate> {
    Ok(&mut object_of(figure, object)?.transfer_function)
}

fn node_of(nodes: &mut [NodeTemplate], node: usize) -> Result<&mut NodeTemplate> {
    match nodes.get_mut(node) {
        Some(found) => Ok(found),
        None => bail!("the transfer function has no node number {}", node + 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_a_volume_otherwise_says_what_changed() {
        let slot = |change: &dyn Fn(&mut VolumeSlot)| {
            let mut slot = VolumeSlot::new("v", "/scans/head.nii".to_owned());
            change(&mut slot);
            slot
        };
        let crop = Some([[0, 8], [0, 8], [0, 8]]);
        let plain = slot(&|_| {});
        let part = slot(&|s| (s.crop, s.reduce) = (crop, Some([2; 3])));
        for (before, now, label) in [
            (&plain, &part, "Read head.nii, cropped, at half resolution"),
            (&part, &plain, "Read head.nii, whole, at full resolution"),
            (
                &part,
                &slot(&|s| (s.crop, s.reduce) = (Some([[1, 8]; 3]), Some([3; 3]))),
                "Read head.nii, cropped otherwise, at 1/3 of the resolution",
            ),
            (&plain, &slot(&|s| s.reduce = Some([2, 2, 1])), "Read head.nii, reduced 2 x 2 x 1"),
            (&plain, &slot(&|s| s.series = Some("CT Abdomen".to_owned())), "Read head.nii, series CT Abdomen"),
            (&plain, &slot(&|s| (s.frame, s.labels) = (2, true)), "Read head.nii, frame 3, as structures"),
            (&plain, &slot(&|s| s.raw = Some("4x4x4xuint8".to_owned())), "Read head.nii, as 4x4x4xuint8"),
            (&plain, &slot(&|s| s.file = "/other/foot.nii".to_owned()), "Use foot.nii"),
            (&plain, &slot(&|s| s.file = "specimen:head@64".to_owned()), "Use specimen:head@64"),
        ] {
            assert_eq!(reading(Some(before), now), label);
        }
    }
}
