//! Every pipeline's shader text, held by a checked-in table of hashes: landing a feature must leave each key without
//! it byte for byte as it was, and a key without a feature has neither its bindings nor its code.

use std::collections::{BTreeMap, BTreeSet};

use fabrica_engine::gpu::shader_library::{MODULES, RaycastKey};
use fabrica_engine::wgpu::naga;
use fabrica_tests::checkout;

/// The recorded table: one line per key, its name and the hash of its text.
const TABLE: &str = "tests/pipelines.txt";
/// Set to 1, the test writes the table that it finds, and fails once more so that nobody accepts unawares.
const ACCEPT: &str = "FABRICA_ACCEPT";

/// FNV-1a of 64 bits: stable over compilers and machines, which the standard library's hashers do not promise.
fn fnv1a(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

fn texts() -> BTreeMap<String, String> {
    let texts: BTreeMap<String, String> =
        RaycastKey::all().map(|key| (key.to_string(), key.wgsl().unwrap_or_else(|e| panic!("{key}: {e}")))).collect();
    assert_eq!(texts.len(), RaycastKey::all().count(), "two keys have one name");
    texts
}

fn table(texts: &BTreeMap<String, String>) -> String {
    texts.iter().map(|(name, text)| format!("{name}: {:016x}\n", fnv1a(text))).collect()
}

/// What became of the recorded keys, a sentence each.
fn changes(recorded: &str, current: &str) -> Vec<String> {
    let parse = |table: &str| -> BTreeMap<String, String> {
        table.lines().filter_map(|l| l.rsplit_once(": ")).map(|(n, h)| (n.to_owned(), h.to_owned())).collect()
    };
    let (old, new) = (parse(recorded), parse(current));
    let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    names
        .into_iter()
        .filter_map(|name| match (old.get(name), new.get(name)) {
            (Some(a), Some(b)) if a == b => None,
            (Some(_), Some(_)) => Some(format!("\"{name}\" has another text")),
            (None, _) => Some(format!("\"{name}\" is new")),
            (_, None) => Some(format!("\"{name}\" is gone")),
        })
        .collect()
}

#[test]
fn pipelines_are_the_recorded_ones() {
    let file = checkout().join(TABLE);
    let recorded = std::fs::read_to_string(&file).unwrap_or_default();
    let current = table(&texts());
    let changes = changes(&recorded, &current);
    if changes.is_empty() && recorded == current {
        return;
    }
    let changes = if changes.is_empty() { "its lines are not in order".to_owned() } else { changes.join("\n  ") };
    if std::env::var_os(ACCEPT).is_some_and(|v| v == "1") {
        std::fs::write(&file, &current).unwrap();
        panic!("{TABLE} is rewritten; look at what changed and run again without {ACCEPT}:\n  {changes}");
    }
    panic!(
        "the shader texts are not those of {TABLE}:\n  {changes}\n\
         A key that does not use what you changed must keep its text. If every line above is meant, run\n  \
         {ACCEPT}=1 cargo test -p fabrica-tests --test suites pipelines\nand commit the table."
    );
}

#[test]
fn the_table_notices_one_changed_byte_and_a_new_key() {
    let texts = texts();
    let recorded = table(&texts);
    assert_eq!(changes(&recorded, &recorded), [""; 0]);
    let mut planted = texts.clone();
    let (name, text) = planted.iter_mut().next().unwrap();
    let expected = format!("\"{name}\" has another text");
    text.push(' ');
    assert_eq!(changes(&recorded, &table(&planted)), [expected]);
    planted = texts;
    planted.insert("raycast of tomorrow".to_owned(), String::new());
    assert_eq!(changes(&recorded, &table(&planted)), ["\"raycast of tomorrow\" is new"]);
    assert_eq!(changes(&table(&planted), &recorded), ["\"raycast of tomorrow\" is gone"]);
    // The published test vectors of FNV-1a.
    assert_eq!((fnv1a(""), fnv1a("foobar")), (0xcbf2_9ce4_8422_2325, 0x8594_4171_f739_67e8));
}

/// What a text brings: its modules and its bindings, functions and types by name.
fn contents(text: &str) -> BTreeSet<String> {
    let module = naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)));
    let mut contents: BTreeSet<String> = MODULES
        .iter()
        .filter(|(name, _)| text.contains(&format!("// ---- {name} ----")))
        .map(|(name, _)| format!("module {name}"))
        .collect();
    for (_, variable) in module.global_variables.iter() {
        if let Some(binding) = &variable.binding {
            contents.insert(format!("binding {} {}", binding.group, binding.binding));
        }
    }
    contents
}

#[test]
fn a_key_without_a_feature_has_neither_its_bindings_nor_its_code() {
    let contents: BTreeMap<String, BTreeSet<String>> =
        texts().into_iter().map(|(name, text)| (name, contents(&text))).collect();
    let all: BTreeSet<&String> = contents.values().flatten().collect();
    // A feature is a word in the keys' names.
    let words: BTreeSet<&str> = contents.keys().flat_map(|name| name.split(' ')).collect();
    let with = |has: &dyn Fn(&str, &BTreeSet<String>) -> bool| -> BTreeSet<&String> {
        contents.iter().filter(|(name, inside)| has(name, inside)).map(|(name, _)| name).collect()
    };
    let mut num_optional = 0;
    for thing in all {
        let holders = with(&|_, inside| inside.contains(thing));
        if holders.len() == contents.len() {
            continue;
        }
        num_optional += 1;
        // What not every key has is there with some words of the name and without some others (a feature, what stands in for it, what
        // only some features together need); two features may share something.
        let is_in = |name: &str, word: &str| name.split(' ').any(|w| w == word);
        let agreed: Vec<(&str, bool)> = words
            .iter()
            .flat_map(|word| [(*word, true), (*word, false)])
            .filter(|(word, is)| holders.iter().all(|name| is_in(name, word) == *is))
            .collect();
        let either = |a: &str, b: &str| with(&|name, _| is_in(name, a) || is_in(name, b));
        let explained = holders == with(&|name, _| agreed.iter().all(|(word, is)| is_in(name, word) == *is))
            || words.iter().any(|a| words.iter().any(|b| holders == either(a, b)));
        assert!(explained, "{thing} is in {holders:?}, which no words of their names tell from the others");
    }
    assert!(num_optional >= 4, "only {num_optional} things are optional");
    // Spelled out for the first feature, by its own text.
    for key in RaycastKey::all() {
        let text = key.wgsl().unwrap();
        assert_eq!(text.contains("var validity:"), key.no_data, "{key}");
        assert_eq!(contents[&key.to_string()].contains("module bind/validity"), key.no_data, "{key}");
        assert_eq!(text.contains("textureSampleLevel(data"), key.filtered, "{key}");
    }
}
