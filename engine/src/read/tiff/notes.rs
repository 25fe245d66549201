//! What programs write about a stack in the description of its first page: ImageJ's lines and OME's XML.

use super::ifd::Page;

/// How the pages make up a volume and how large its voxels are.
#[derive(Clone, Debug, PartialEq)]
pub struct Notes {
    pub format: &'static str,
    /// Images, if the description says how many there are.
    pub num_images: Option<u64>,
    pub num_channels: u64,
    pub num_slices: Option<u64>,
    pub num_frames: u64,
    /// The axes of which the pages count the first fastest: some order of c, z, t.
    pub order: [u8; 3],
    /// Along x, y, z, where it is known.
    pub spacing_mm: [Option<f64>; 3],
    /// Data value of the stored number: intercept and slope.
    pub calibration: Option<[f64; 2]>,
    pub warnings: Vec<String>,
}

impl Notes {
    /// What the first page says.
    pub fn of(page: &Page) -> Self {
        let mut notes = Self {
            format: "TIFF",
            num_images: None,
            num_channels: 1,
            num_slices: None,
            num_frames: 1,
            order: *b"czt",
            spacing_mm: [None; 3],
            calibration: None,
            warnings: Vec::new(),
        };
        if page.description.starts_with("ImageJ=") {
            notes.read_imagej(page);
        } else if page.description.contains("<OME") && page.description.contains("<Pixels") {
            notes.read_ome(&page.description);
        } else {
            notes.read_resolution(page);
        }
        notes
    }

    fn read_imagej(&mut self, page: &Page) {
        let get = |key: &str| page.description.lines().find_map(|l| l.trim().strip_prefix(key)?.strip_prefix('='));
        let count = |key: &str| get(key).and_then(|v| v.trim().parse().ok()).filter(|&n: &u64| n > 0);
        let number = |key: &str| get(key).and_then(|v| v.trim().parse().ok()).filter(|n: &f64| n.is_finite());
        self.format = "ImageJ TIFF";
        self.num_images = count("images");
        self.num_channels = count("channels").unwrap_or(1);
        self.num_frames = count("frames").unwrap_or(1);
        self.num_slices = count("slices");
        // cf=0 is ImageJ's straight line; signed 16-bit numbers are such a line as well.
        if let (Some("0"), Some(intercept), Some(slope)) = (get("cf").map(str::trim), number("c0"), number("c1"))
            && slope != 0.0
        {
            self.calibration = Some([intercept, slope]);
        }
        let unit = get("unit").unwrap_or_default().trim().to_owned();
        let Some(mm) = mm_per_unit(&unit) else {
            let is_pixel = matches!(unit.to_lowercase().as_str(), "" | "pixel" | "pixels");
            if !is_pixel {
                self.warnings.push(format!("The unit of length `{unit}` is not known."));
            }
            // Voxels still have a shape.
            if let (Some([x, y]), Some(z)) = (page.resolution, number("spacing").filter(|z| *z > 0.0)) {
                self.spacing_mm = [Some(1.0), Some(x / y), Some(z * x)];
            }
            return;
        };
        if let Some([x, y]) = page.resolution {
            self.spacing_mm = [Some(mm / x), Some(mm / y), None];
        }
        self.spacing_mm[2] = number("spacing").map(|z| z.abs() * mm).filter(|z| *z > 0.0);
    }

    fn read_ome(&mut self, xml: &str) {
        let Some((_, rest)) = xml.split_once("<Pixels") else { return };
        let pixels = rest.split('>').next().unwrap_or_default();
        let get = |key: &str| {
            let key = format!("{key}=");
            let at = pixels.match_indices(&key).find(|(i, _)| pixels[..*i].ends_with(char::is_whitespace))?.0;
            let value = &pixels[at + key.len()..];
            let quote = value.chars().next().filter(|c| matches!(c, '"' | '\''))?;
            value[1..].split(quote).next()
        };
        let count = |key: &str| get(key).and_then(|v| v.trim().parse().ok()).filter(|&n: &u64| n > 0);
        self.format = "OME-TIFF";
        self.num_channels = count("SizeC").unwrap_or(1);
        self.num_frames = count("SizeT").unwrap_or(1);
        self.num_slices = count("SizeZ");
        if let Some(order) = get("DimensionOrder").and_then(|o| o.to_lowercase().strip_prefix("xy").map(str::to_owned))
            && let [a @ b'c'..=b'z', b @ b'c'..=b'z', c @ b'c'..=b'z'] = *order.as_bytes()
            && [a, b, c].iter().all(|axis| b"czt".contains(axis))
            && a != b
            && b != c
            && a != c
        {
            self.order = [a, b, c];
        }
        for (i, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            let size = get(&format!("PhysicalSize{axis}")).and_then(|v| v.trim().parse().ok());
            let unit = get(&format!("PhysicalSize{axis}Unit")).unwrap_or("µm");
            let unit = unit.replace("&#181;", "µ").replace("&#xB5;", "µ");
            match mm_per_unit(&unit) {
                Some(mm) => self.spacing_mm[i] = size.map(|s: f64| s * mm).filter(|s| s.is_finite() && *s > 0.0),
                None if size.is_some() => self.warnings.push(format!("The unit of length `{unit}` is not known.")),
                None => {}
            }
        }
    }

    fn read_resolution(&mut self, page: &Page) {
        let Some([x, y]) = page.resolution else { return };
        let is_for_print = |per_inch: f64| [72.0, 96.0, 150.0, 200.0, 300.0, 600.0, 1200.0].contains(&per_inch.round());
        match page.resolution_unit {
            // What cameras and editors write says how large a print is, not a voxel.
            2 if is_for_print(x) || is_for_print(x * 2.54) => {}
            3 if is_for_print(x * 2.54) => {}
            2 => self.spacing_mm = [Some(25.4 / x), Some(25.4 / y), None],
            3 => self.spacing_mm = [Some(10.0 / x), Some(10.0 / y), None],
            _ if x != y => self.spacing_mm = [Some(1.0), Some(x / y), None],
            _ => {}
        }
    }
}

/// Millimeters of a unit of length as programs write it.
fn mm_per_unit(unit: &str) -> Option<f64> {
    Some(match unit.to_lowercase().as_str() {
        "mm" | "millimeter" | "millimeters" | "millimetre" => 1.0,
        "micron" | "microns" | "um" | "µm" | "μm" | "\\u00b5m" | "micrometer" | "micrometers" => 1e-3,
        "nm" | "nanometer" | "nanometers" => 1e-6,
        "cm" | "centimeter" | "centimeters" => 10.0,
        "m" | "meter" | "meters" => 1000.0,
        "inch" | "inches" | "in" | "\"" => 25.4,
        _ => return None,
    })
}
