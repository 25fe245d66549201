//! The figures that come with the program: places to begin.

use std::sync::LazyLock;

use super::Template;

/// A figure with its picture.
pub struct Shipped {
    /// The name of its file in `templates/`, without the extension.
    pub name: &'static str,
    /// What it shows and what data it is for.
    pub description: &'static str,
    /// What it needs that does not come with the program; none: it opens by itself.
    pub needs: Option<&'static str>,
    text: &'static str,
    /// A small picture of it, PNG; made by `scripts/thumbnails.sh`.
    pub picture: &'static [u8],
}

macro_rules! shipped {
    ($name:literal, $description:literal) => {
        shipped!($name, $description, None)
    };
    ($name:literal, $description:literal, $needs:expr) => {
        Shipped {
            name: $name,
            description: $description,
            needs: $needs,
            text: include_str!(concat!("../../../templates/", $name, ".json")),
            picture: include_bytes!(concat!("../../../templates/pictures/", $name, ".png")),
        }
    };
}

/// What the figures of an abdomen need: their data may not be handed on with the program.
const ABDOMEN: Option<&str> =
    Some("A CT of the abdomen with a label map of its organs, as TotalSegmentator names them");

/// Every one, in the order in which they are offered.
pub const SHIPPED: &[Shipped] = &[
    shipped!("head", "CT in HU: bone in ivory"),
    shipped!("head_glass", "CT in HU: bone under the skin's contour"),
    shipped!("head_engraving", "CT in HU: an engraving on paper"),
    shipped!("head_hatched", "CT in HU: hatched in level lines, crossed where it is dark"),
    shipped!("head_ink", "CT in HU: plaster with inked contours of one width"),
    shipped!("head_cartoon", "CT in HU: three tones of light and a brush line"),
    shipped!("head_veil", "CT in HU: skin and muscle that stay at their edges"),
    shipped!("head_xray", "CT in HU: translucent throughout"),
    shipped!("head_edges", "CT in HU, a 2-D function: soft tissue at its boundaries, around bone"),
    shipped!("head_brain", "A label map: brain, vessels and nerves within a veil of bone"),
    shipped!("head_distance", "A 2-D function: bone that turns to glass near the brain"),
    shipped!("head_importance", "A 2-D function: structures in looks by what they are to tell"),
    shipped!("head_brain_out", "A selection that was moved: the brain above the place it left"),
    shipped!("head_jaw", "A selection that meets its ghost: the jaw in green, where it was in red, both in blue"),
    shipped!("head_opened", "An object in parts: a piece of the skull, cut out and lifted"),
    shipped!("turtle", "CT in HU: bones and organs within a shell of amber"),
    shipped!("turtle_stippled", "CT in HU: skin and shell in dots of ink"),
    shipped!("engine", "Industrial CT: glass castings around brass"),
    shipped!("engine_lines", "Industrial CT: the same glass, with drawn edges"),
    shipped!("engine_steel", "Industrial CT: a solid of steel, with fine lines"),
    shipped!("engine_exploded", "An object in parts: an engine in five slices, with its pistons cut"),
    shipped!("abdomen_organs", "A label map: organs in looks by value, hollow ones open", ABDOMEN),
    shipped!("abdomen_selection", "A label map: one organ in color, the others in plaster", ABDOMEN),
];

static TITLES: LazyLock<Vec<String>> = LazyLock::new(|| SHIPPED.iter().map(|s| s.figure().title).collect());

/// What each of [`SHIPPED`] is called.
pub fn titles() -> &'static [String] {
    &TITLES
}

impl Shipped {
    /// The figure.
    ///
    /// # Panics
    /// Never: a test reads each of them.
    #[expect(clippy::expect_used, reason = "what is compiled in is tested")]
    pub fn figure(&self) -> Template {
        Template::parse(self.text).expect("shipped templates are valid")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_template_is_offered_and_readable() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../templates");
        let mut files: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "json"))
            .map(|p| p.file_stem().unwrap().to_string_lossy().into_owned())
            .collect();
        files.sort();
        let mut names: Vec<&str> = SHIPPED.iter().map(|s| s.name).collect();
        names.sort_unstable();
        assert_eq!(names, files);
        for shipped in SHIPPED {
            assert!(!shipped.figure().title.is_empty() && !shipped.description.is_empty());
            // What needs nothing opens by itself.
            let opens = shipped.figure().volumes.iter().all(|v| v.file.starts_with("specimen:"));
            assert_eq!(opens, shipped.needs.is_none(), "{}", shipped.name);
            assert!(fabrica_engine::image_out::decode_png(shipped.picture, std::path::Path::new(shipped.name)).is_ok());
        }
    }
}
