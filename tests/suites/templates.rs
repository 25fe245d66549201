//! The shipped templates: they parse, name styles that exist, follow the published schema's version, and draw.

use std::path::{Path, PathBuf};

use fabrica_engine::Progress;
use fabrica_engine::render::RenderOptions;
use fabrica_engine::specimen::Request;
use fabrica_engine::styles::StyleLibrary;
use fabrica_studio::figure::Template;
use fabrica_studio::figure::bridge::scene;
use fabrica_studio::figure::source::VolumeSource;
use fabrica_studio::figure::sources::{Replacement, load};
use fabrica_studio::figure::template::Domain;
use fabrica_studio::figure::theme::Themes;
use fabrica_tests::{checkout, data, renderer};

fn shipped() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(checkout().join("templates"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .collect();
    files.sort();
    assert!(files.len() >= 2, "two templates are shipped at least");
    files
}

fn small_head() -> Replacement {
    let source = VolumeSource::Specimen(Request::plain("head", 64));
    Replacement { source, options: Default::default() }
}

#[test]
fn shipped_templates_survive_a_rewrite() {
    for file in shipped() {
        let template = Template::read(&file).unwrap();
        let once = template.to_json().unwrap();
        assert_eq!(Template::parse(&once).unwrap(), template, "{}", file.display());
        let original: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
        let rewritten: serde_json::Value = serde_json::from_str(&once).unwrap();
        for (key, value) in original.as_object().unwrap() {
            if key != "camera" && key != "volumes" && key != "objects" && key != "figure" {
                assert_eq!(rewritten.get(key), Some(value), "{}: {key}", file.display());
            }
        }
    }
}

/// Whether a template comes with its data.
fn has_data(template: &Template) -> bool {
    template.volumes.iter().all(|volume| volume.file.starts_with("specimen:"))
}

#[test]
fn shipped_templates_draw_a_small_head() {
    let mut renderer = renderer();
    let styles = StyleLibrary::embedded();
    let mut pictures = Vec::new();
    for file in shipped() {
        let template = Template::read(&file).unwrap();
        if !has_data(&template) {
            continue;
        }
        let progress = Progress::new();
        let volumes = load(&template, &checkout().join("templates"), &[small_head()], &[], &progress).unwrap();
        let (scene, _) = scene(&template, &volumes, &styles, &progress).unwrap();
        let image = renderer.render(&scene, [64, 64], &RenderOptions::default(), &progress).unwrap();
        let corner = image.pixels[0];
        let drawn = image.pixels.iter().filter(|p| p.iter().zip(&corner).any(|(a, b)| (a - b).abs() > 0.05)).count();
        assert!(drawn > 64 * 64 / 8, "{} draws {drawn} pixels", file.display());
        pictures.push(image);
    }
    assert!(pictures.windows(2).all(|w| w[0] != w[1]));
}

#[test]
fn shipped_templates_draw_in_every_theme() {
    let mut renderer = renderer();
    let styles = StyleLibrary::embedded();
    let progress = Progress::new();
    let abdomen = data("ct_abdomen_3mm_slab.nii.gz").zip(data("ct_abdomen_3mm_slab_labels.nii.gz"));
    for file in shipped() {
        let mut template = Template::read(&file).unwrap();
        let (volume, labels) = match &abdomen {
            _ if has_data(&template) => (small_head(), vec![]),
            Some((scan, labels)) => (
                Replacement { source: VolumeSource::Path(scan.clone()), options: Default::default() },
                vec![labels.to_str().unwrap().to_owned()],
            ),
            None => continue,
        };
        let sources = load(&template, &checkout().join("templates"), &[volume], &labels, &progress).unwrap();
        let mut pictures = Vec::new();
        for theme in std::iter::once(None).chain(Themes::built_in().all().iter().map(Some)) {
            template.theme = theme.map(|theme| theme.name.clone());
            let (scene, notes) = scene(&template, &sources, &styles, &progress).unwrap();
            let drawn_in = format!("{} in {:?}", file.display(), template.theme);
            assert!(!notes.iter().any(|note| note.contains("theme")), "{drawn_in}: {notes:?}");
            let image = renderer.render(&scene, [32, 32], &RenderOptions::default(), &progress).unwrap();
            let corner = image.pixels[0];
            let differs = |p: &&[f32; 4]| p.iter().zip(&corner).any(|(a, b)| (a - b).abs() > 0.02);
            let drawn = image.pixels.iter().filter(differs).count();
            assert!(drawn > 32 * 32 / 16, "{drawn_in} draws {drawn} pixels");
            pictures.push((drawn_in, image.pixels));
        }
        for (i, (name, picture)) in pictures.iter().enumerate() {
            for (other, same) in &pictures[..i] {
                assert!(picture != same, "{name} is the same picture as {other}");
            }
        }
    }
}

#[test]
fn templates_of_an_abdomen_draw_it_with_its_structures() {
    let (Some(scan), Some(labels)) = (data("ct_abdomen_3mm_slab.nii.gz"), data("ct_abdomen_3mm_slab_labels.nii.gz"))
    else {
        return;
    };
    let mut renderer = renderer();
    let styles = StyleLibrary::embedded();
    let labels = [labels.to_str().unwrap().to_owned()];
    let progress = Progress::new();
    let mut num_templates = 0;
    for file in shipped() {
        let template = Template::read(&file).unwrap();
        if has_data(&template) {
            continue;
        }
        num_templates += 1;
        let scan = Replacement { source: VolumeSource::Path(scan.clone()), options: Default::default() };
        let sources = load(&template, Path::new(""), &[scan], &labels, &progress).unwrap();
        // Every structure that the template dresses is there, by its name.
        let names: Vec<&str> = sources.selections[0].structures.iter().map(|s| s.label.name.as_str()).collect();
        for structure in &template.objects[0].regions[0].structures {
            assert!(names.contains(&structure.structure.as_str()), "{}: {}", file.display(), structure.structure);
        }
        let (scene, notes) = scene(&template, &sources, &styles, &progress).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        let image = renderer.render(&scene, [120, 90], &RenderOptions::default(), &progress).unwrap();
        let differs = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 0.05);
        let drawn = image.pixels.iter().filter(|p| differs(p, &image.pixels[0])).count();
        assert!(drawn > 120 * 90 / 4, "{} draws {drawn} pixels", file.display());
        // The organ that is told from the others is orange, and seen.
        let is_orange = |[r, g, b, _]: &[f32; 4]| *r > 3.0 * b && *r > 1.8 * g && *r > 0.1;
        let orange = image.pixels.iter().filter(|p| is_orange(p)).count();
        assert!(orange > 120, "{}: {orange} orange pixels", file.display());
    }
    assert_eq!(num_templates, 2);
}

#[test]
fn a_template_fits_another_dataset_by_percentiles() {
    let (Some(a), Some(b)) = (data("orient_RAS.nii.gz"), data("someones_anatomy.nii.gz")) else { return };
    let mut template = Template::read(&checkout().join("templates/head.json")).unwrap();
    let function = &mut template.objects[0].transfer_function;
    function.domain = Domain::Percentile;
    function.nodes.truncate(2);
    for (node, at) in function.nodes.iter_mut().zip([10.0, 30.0]) {
        node.at = at;
    }
    let progress = Progress::new();
    let mut thresholds = Vec::new();
    for file in [a, b] {
        let replacement = Replacement { source: VolumeSource::Path(file), options: Default::default() };
        let volumes = load(&template, checkout(), &[replacement], &[], &progress).unwrap();
        let (scene, notes) = scene(&template, &volumes, &StyleLibrary::embedded(), &progress).unwrap();
        assert!(notes.iter().any(|n| n.contains("background")), "the background must be said: {notes:?}");
        let nodes = &scene.objects[0].transfer_function.nodes;
        let statistics = volumes.volumes[0].statistics(&progress).unwrap();
        assert!(nodes[0].value > statistics.background && nodes[1].value > nodes[0].value);
        thresholds.push(nodes[0].value);
        let image = renderer().render(&scene, [48, 48], &RenderOptions::default(), &progress).unwrap();
        let middle = image.pixels[24 * 48 + 24];
        assert!(middle != image.pixels[0], "nothing is drawn");
    }
    assert_ne!(thresholds[0], thresholds[1], "two scanners have two scales");
}

#[test]
fn faults_are_sentences() {
    let styles = StyleLibrary::embedded();
    let progress = Progress::new();
    let mut template = Template::read(&checkout().join("templates/head.json")).unwrap();
    let volumes = load(&template, checkout(), &[small_head()], &[], &progress).unwrap();
    template.objects[0].transfer_function.nodes[0].style = "porcelan".to_owned();
    let message = scene(&template, &volumes, &styles, &progress).unwrap_err().to_string();
    assert!(message.contains("porcelan") && message.contains("porcelain"), "{message}");
    let two = [small_head(), small_head()];
    let message = load(&template, checkout(), &two, &[], &progress).unwrap_err().to_string();
    assert!(message.contains("2 volumes are given") && message.contains("1 slot"), "{message}");
}

#[test]
fn sliders_of_styles_reach_the_scene_or_are_a_sentence() {
    let progress = Progress::new();
    let plain = Template::read(&checkout().join("templates/head_hatched.json")).unwrap();
    let sources = load(&plain, &checkout().join("templates"), &[small_head()], &[], &progress).unwrap();
    let styles = StyleLibrary::embedded();
    let of = |change: &dyn Fn(&mut Template)| {
        let mut template = plain.clone();
        change(&mut template);
        scene(&template, &sources, &styles, &progress).map(|(scene, _)| scene)
    };
    let spacing = |change: &dyn Fn(&mut Template)| of(change).unwrap().styles[0].pattern.as_ref().unwrap().spacing_pt;
    assert_eq!(spacing(&|_| ()), 2.2, "as the template has it");
    assert_eq!(spacing(&|t| t.style_settings.clear()), 2.6, "the style's own");
    let set = |t: &mut Template, style: &str, slider: &str, value: f64| {
        t.style_settings.entry(style.to_owned()).or_default().insert(slider.to_owned(), value);
    };
    assert_eq!(spacing(&|t| set(t, "cross_hatched", "Spacing", 5.0)), 5.0);
    // Sliders of styles that are not drawn with do not matter: a theme may have taken their place.
    assert_eq!(spacing(&|t| set(t, "nowhere", "Spacing", 5.0)), 2.2);
    assert!(of(&|t| t.theme = Some("xray".to_owned())).unwrap().styles.iter().all(|style| style.pattern.is_none()));
    let sentence =
        |style: &str, slider: &str, value: f64| of(&|t| set(t, style, slider, value)).unwrap_err().to_string();
    assert!(sentence("cross_hatched", "Depth", 1.0).contains("has no slider \"Depth\"; it has Spacing, Crossings"));
    assert!(sentence("cross_hatched", "Spacing", 100.0).contains("choose a value from 1 to 8"));
}
