//! The house's rules that no compiler checks: crate boundaries, one version of what must be one, shader layouts,
//! nothing large or foreign in the tree.

use std::collections::BTreeSet;
use std::process::Command;

use fabrica_engine::gpu::regions::{LIST_WIDTH, SLOT_EDGE, WHOLE};
use fabrica_engine::gpu::shader_library::{MODULES, RaycastKey};
use fabrica_engine::pass::bodies::{BodiesUniform, BodyUniform};
use fabrica_engine::pass::patterns::PatternsUniform;
use fabrica_engine::pass::raycast::{FrameUniform, LightUniform, LightingUniform, ObjectUniform};
use fabrica_engine::pass::regions::{FunctionsUniform, LayerUniform, RegionsUniform};
use fabrica_engine::scene::moved::MAX_BODIES;
use fabrica_engine::scene::quality::{MAX_ROUNDS, PARTS, rounds_per_look, rounds_per_piece};
use fabrica_engine::wgpu::naga;
use fabrica_tests::checkout;

/// Names of all packages that `package` depends on, itself included.
fn dependencies(package: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "-p", package, "-e", "normal", "--prefix", "none", "--format", "{p}"])
        .current_dir(checkout())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|l| l.split_whitespace().next()).map(str::to_owned).collect()
}

#[test]
fn the_engine_knows_no_window_and_no_physics() {
    let engine = dependencies("fabrica-engine");
    assert!(engine.contains("wgpu") && engine.contains("glam"), "{engine:?}");
    for foreign in ["egui", "eframe", "winit", "rapier3d", "clap", "fabrica-studio"] {
        assert!(!engine.contains(foreign), "the engine depends on {foreign}");
    }
    assert!(dependencies("fabrica-studio").contains("fabrica-engine"));
}

#[test]
fn one_version_of_wgpu_and_glam() {
    let lock = std::fs::read_to_string(checkout().join("Cargo.lock")).unwrap();
    for package in ["wgpu", "naga", "glam"] {
        let count = lock.matches(&format!("name = \"{package}\"\n")).count();
        assert_eq!(count, 1, "{package} is in the tree {count} times");
    }
}

fn parse(text: &str) -> naga::Module {
    naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)))
}

#[test]
fn every_pipeline_key_is_valid_wgsl() {
    for key in RaycastKey::all() {
        let module = parse(&key.wgsl().unwrap());
        let mut validator =
            naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::all());
        validator.validate(&module).unwrap_or_else(|e| panic!("{key}: {e:?}"));
    }
}

#[test]
fn every_shader_module_is_used() {
    let texts: Vec<String> = RaycastKey::all().map(|k| k.wgsl().unwrap()).collect();
    for (name, _) in MODULES {
        assert!(texts.iter().any(|t| t.contains(&format!("---- {name} ----"))), "no key uses {name}");
    }
    let mut files = 0;
    for folder in ["shaders", "shaders/lib", "shaders/bind"] {
        for entry in std::fs::read_dir(checkout().join(folder)).unwrap() {
            files += usize::from(entry.unwrap().path().extension().is_some_and(|e| e == "wgsl"));
        }
    }
    assert_eq!(files, MODULES.len(), "a shader file is not in the library");
}

#[test]
fn constants_that_both_sides_know_are_the_same() {
    let module = parse(&richest().wgsl().unwrap());
    for (name, ours) in [
        ("PARTS", PARTS),
        ("MAX_ROUNDS", MAX_ROUNDS),
        ("ROUNDS_PER_PIECE", rounds_per_piece(rounds_per_look(true, true))),
        ("LIST_WIDTH", LIST_WIDTH as u32),
        ("SLOT_EDGE", SLOT_EDGE as u32),
        ("WHOLE", WHOLE),
        ("MAX_BODIES", MAX_BODIES as u32),
    ] {
        let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).unwrap();
        let theirs = &module.global_expressions[constant.init];
        assert!(
            matches!(theirs, naga::Expression::Literal(naga::Literal::U32(n)) if *n == ours),
            "{name} is {ours} here and {theirs:?} in the shader"
        );
    }
}

/// The key whose text has most of what both sides know.
fn richest() -> RaycastKey {
    RaycastKey::all().find(|key| key.functions && key.meetings && key.many_bodies && key.lit && key.patterns).unwrap()
}

/// Offset and name of each member of a struct, from the shader's own layout.
fn shader_layout(name: &str) -> (u32, Vec<(u32, String)>) {
    let module = parse(&richest().wgsl().unwrap());
    for (_, ty) in module.types.iter() {
        if ty.name.as_deref() == Some(name)
            && let naga::TypeInner::Struct { members, span } = &ty.inner
        {
            return (*span, members.iter().map(|m| (m.offset, m.name.clone().unwrap())).collect());
        }
    }
    panic!("no struct {name}");
}

#[test]
fn uniforms_lie_as_the_shaders_read_them() {
    for (name, size, fields) in [
        ("Frame", size_of::<FrameUniform>(), FrameUniform::FIELDS),
        ("Object", size_of::<ObjectUniform>(), ObjectUniform::FIELDS),
        ("Regions", size_of::<RegionsUniform>(), RegionsUniform::FIELDS),
        ("Functions", size_of::<FunctionsUniform>(), FunctionsUniform::FIELDS),
        ("Layer", size_of::<LayerUniform>(), LayerUniform::FIELDS),
        ("Light", size_of::<LightUniform>(), LightUniform::FIELDS),
        ("Lighting", size_of::<LightingUniform>(), LightingUniform::FIELDS),
        ("Patterns", size_of::<PatternsUniform>(), PatternsUniform::FIELDS),
        ("Body", size_of::<BodyUniform>(), BodyUniform::FIELDS),
        ("Bodies", size_of::<BodiesUniform>(), BodiesUniform::FIELDS),
    ] {
        let (span, members) = shader_layout(name);
        assert_eq!(span as usize, size, "{name}");
        let ours: Vec<(u32, String)> = fields.iter().map(|(n, o)| (*o as u32, (*n).to_owned())).collect();
        assert_eq!(members, ours, "{name}");
    }
}

#[test]
fn the_tree_holds_no_large_file_and_no_debris() {
    let output = Command::new("git").args(["ls-files", "-z"]).current_dir(checkout()).output().unwrap();
    let list = String::from_utf8(output.stdout).unwrap();
    let files: Vec<&str> = list.split('\0').filter(|f| !f.is_empty()).collect();
    assert!(files.len() > 30, "git lists {} files", files.len());
    for file in files {
        let Ok(bytes) = std::fs::read(checkout().join(file)) else { continue };
        assert!(bytes.len() < 1_300_000, "{file} has {} bytes", bytes.len());
        if [".rs", ".wgsl", ".md", ".toml", ".json"].iter().any(|e| file.ends_with(e)) {
            let text = String::from_utf8(bytes).unwrap();
            // Put together here so that this file does not find itself.
            for word in
                [concat!("todo", "!("), concat!("unimplemented", "!("), concat!("dbg", "!("), concat!("/wo", "rk/")]
            {
                assert!(!text.contains(word), "{file} contains {word}");
            }
            assert!(!text.contains('\r'), "{file} has carriage returns");
        }
    }
}

#[test]
fn the_window_words_its_faults_itself() {
    // `{error:#}` would name options of the command line (studio/src/editor/wording.rs).
    let mut folders = vec![checkout().join("studio/src/editor")];
    let mut num_files = 0;
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            num_files += 1;
            let text = std::fs::read_to_string(&path).unwrap();
            // What is written to the terminal, and notes about the state folder, name no option.
            let lines = text.lines().filter(|l| l.contains("{error:#}") && !l.contains("eprintln!"));
            assert_eq!(lines.collect::<Vec<_>>(), [""; 0], "{}", path.display());
        }
    }
    assert!(num_files > 20);
}
