//! Whether `--max-error` keeps its promise on figures that no shipped template shows: real scans, looks and views drawn by lot,
//! against the refined reference. `cargo bench -p fabrica-studio --bench held_out [-- NUMBER]`; it takes minutes.

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::path::PathBuf;

use fabrica_engine::estimate::for_error;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::measure::{Converged, median};
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::{Error, Progress};
use fabrica_studio::figure::{Template, bridge, sources};

/// Scans that no shipped template shows .
const VOLUMES: [&str; 8] = [
    "brain_skullstripped_eun.nii.gz",
    "stroke_T1.nii.gz",
    "macaque_t1.nii.gz",
    "avf_float.nrrd",
    "fuel.nii.gz",
    "cta_heart_aorta.nii.gz",
    "ct_abdomen_3mm.nii.gz",
    "ct_head_gantry_tilt.nii.gz",
];
const STYLES: [&str; 10] =
    ["bone", "clay", "porcelain", "muscle", "glass", "chalk", "xray", "unshaded", "engraving", "chrome"];
const BOUNDS: [f64; 3] = [1.0, 2.0, 4.0];
const SIZE: [u32; 2] = [128, 128];

/// A linear congruential generator: the same lot on every machine.
struct Lot(u64);

impl Lot {
    /// Even in 0 … 1.
    fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn one_of<'a>(&mut self, of: &[&'a str]) -> &'a str {
        of[((self.draw() * of.len() as f64) as usize).min(of.len() - 1)]
    }
}

/// A figure by lot: an opaque surface, a veil, or a surface in a veil.
fn template(file: &str, lot: &mut Lot) -> String {
    let (a, b) = (lot.one_of(&STYLES), lot.one_of(&STYLES));
    let edge = 5.0 + 60.0 * lot.draw();
    let width = 1.0 + 20.0 * lot.draw();
    let nodes = match (lot.draw() * 3.0) as u32 {
        0 => format!(
            r#"{{"at":{edge},"style":"{a}","opacity":0}},{{"at":{},"style":"{a}","opacity":0.95}}"#,
            edge + width
        ),
        1 => format!(
            r#"{{"at":{edge},"style":"{a}","opacity":0}},{{"at":{},"style":"{b}","opacity":{:.3}}}"#,
            edge + width,
            0.02 + 0.2 * lot.draw()
        ),
        _ => format!(
            r#"{{"at":1,"style":"{a}","opacity":0}},{{"at":4,"style":"{a}","opacity":0.1}},{{"at":{edge},"style":"{b}","opacity":0.02}},{{"at":{},"style":"{b}","opacity":0.9}}"#,
            edge + width
        ),
    };
    let from = [0, 1, 2].map(|_| 2.0 * lot.draw() - 1.0);
    format!(
        r#"{{"fabrica":1,"volumes":[{{"name":"v","file":{file:?}}}],"objects":[{{"volume":"v","transfer_function":{{"domain":"percentile","reference_length_mm":1.0,"nodes":[{nodes}]}}}}],"camera":{{"from":{from:?},"height":{:.3}}},"background":"{}","figure":{{"width_mm":80,"height_mm":80,"dpi":300}}}}"#,
        0.5 + lot.draw(),
        if lot.draw() < 0.5 { "#ffffff" } else { "transparent" }
    )
}

fn main() {
    let number: usize = std::env::args().find_map(|a| a.parse().ok()).unwrap_or(16);
    let data = PathBuf::from(std::env::var("FABRICA_TEST_DATA").unwrap_or_else(|_| "../../shared/data".to_owned()));
    let data = std::path::absolute(data).unwrap();
    let styles = StyleLibrary::embedded();
    let progress = Progress::new();
    let mut renderer = Renderer::new(GpuContext::new(&AdapterChoice::Auto).unwrap());
    println!("adapter: {:?}", renderer.context().adapter.name);
    println!("{:32}{:>8}{:>8}{:>10}{:>10}{:>10}", "volume", "bound", "step", "estimate", "true", "unsettled");
    let (mut kept, mut close, mut tightness) = (0usize, 0usize, Vec::new());
    let mut lot = Lot(20_261_122);
    let mut refused = 0;
    for i in 0..number {
        let name = VOLUMES[i % VOLUMES.len()];
        let text = template(data.join(name).to_str().unwrap(), &mut lot);
        let template = Template::parse(&text).unwrap();
        let volumes = sources::load(&template, &data, &[], &[], &progress).unwrap();
        let (mut scene, _) = bridge::scene(&template, &volumes, &styles, &progress).unwrap();
        let converged = Converged::of(&scene, SIZE, &progress).unwrap();
        for bound in BOUNDS {
            let estimate = match for_error(&mut renderer, &scene, SIZE, bound, &progress) {
                Ok(estimate) => estimate,
                Err(Error::Scene { what, remedy }) => {
                    println!("{name:32}{bound:>8}  {what}; {remedy}");
                    refused += 1;
                    continue;
                }
                Err(error) => panic!("{error}"),
            };
            scene.quality = estimate.quality;
            let picture = renderer.render(&scene, SIZE, &RenderOptions::default(), &progress).unwrap();
            let found = converged.difference(&picture, scene.background).unwrap();
            let truth = found.codes.p999;
            println!(
                "{name:32}{bound:>8}{:>8.4}{:>10.3}{truth:>10.3}{:>10}",
                estimate.quality.step_voxels, estimate.codes, found.num_unsettled
            );
            kept += usize::from(truth <= bound);
            close += usize::from((0.5..=2.0).contains(&(estimate.codes / truth)));
            tightness.push(bound / truth);
        }
    }
    let n = tightness.len();
    println!(
        "{n} figures, {refused} refused: within the bound {:.1} %, estimate within a factor of 2 {:.1} %, median of bound/true {:.2}",
        100.0 * kept as f64 / n as f64,
        100.0 * close as f64 / n as f64,
        median(&mut tightness)
    );
}
