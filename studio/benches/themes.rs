//! How long a figure takes to show another theme: from asking the painter to the coarse picture, against a turned camera in the same
//! theme; with and without what the window does when its list of themes is opened. `MESA_SHADER_CACHE_DISABLE=1 cargo bench -p
//! fabrica-studio --bench themes --profile dev [-- TEMPLATE]` (default: the shipped head in glass).

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use fabrica_engine::Progress;
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::styles::StyleLibrary;
use fabrica_studio::editor::painter::{Painter, Request, Stage, Update};
use fabrica_studio::figure::sources::{self, Sources};
use fabrica_studio::figure::template::Template;
use fabrica_studio::figure::theme::Themes;

const SIZE: [u32; 2] = [900, 700];
/// Between two swaps, so that what goes on in the background has come to its end, as it has when somebody looks at a picture.
const REST: Duration = Duration::from_millis(1500);

fn main() {
    let path = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let path =
        path.map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../templates/head_glass.json"), PathBuf::from);
    let progress = Progress::new();
    let plain = Template::read(&path).unwrap();
    let sources = sources::load(&plain, path.parent().unwrap(), &[], &[], &progress).unwrap();
    let styles = Arc::new(StyleLibrary::embedded());
    // As the window's gallery does at its start.
    styles.names().iter().for_each(|name| drop(styles.get(name)));
    for is_expected in [false, true] {
        println!("{}", if is_expected { "with the list of themes opened before" } else { "without" });
        swap(&plain, &sources, &styles, is_expected);
    }
    println!("load {}", std::fs::read_to_string("/proc/loadavg").unwrap_or_default().trim());
}

fn swap(plain: &Template, sources: &Sources, styles: &Arc<StyleLibrary>, is_expected: bool) {
    let themes = Arc::new(Themes::built_in().clone());
    let (wake, woken) = std::sync::mpsc::channel();
    let painter = Painter::start(AdapterChoice::Software, styles.clone(), themes.clone(), move || {
        let _ = wake.send(());
    });
    let request = |figure: &Template| Request {
        figure: Arc::new(figure.clone()),
        sources: sources.clone(),
        size: SIZE,
        coarse_only: false,
        is_painted: false,
    };
    // Milliseconds to the coarse picture; it waits for the finished one where it is told to.
    let ask = |figure: &Template, until_refined: bool| {
        let begun = Instant::now();
        let number = painter.ask(request(figure));
        let mut coarse = None;
        loop {
            woken.recv().unwrap();
            for update in painter.updates() {
                match update {
                    Update::Rows { number: of, stage, .. } if of == number => match stage {
                        Stage::Coarse => coarse = Some(1e3 * begun.elapsed().as_secs_f64()),
                        Stage::Refined { .. } => return coarse.unwrap(),
                        _ => {}
                    },
                    Update::Failed { message, .. } => panic!("{message}"),
                    _ => {}
                }
            }
            if let Some(coarse) = coarse.filter(|_| !until_refined) {
                return coarse;
            }
        }
    };
    let mut figure = plain.clone();
    ask(&figure, true);
    std::thread::sleep(REST);
    if is_expected {
        let in_theme = |name: &String| Template { theme: Some(name.clone()), ..plain.clone() };
        painter.expect(themes.all().iter().map(|theme| request(&in_theme(&theme.name))).collect());
        // A list is read before something of it is chosen; under load, slower.
        std::thread::sleep(4 * REST);
    }
    let (mut turned, mut swapped) = (Vec::new(), [Vec::new(), Vec::new()]);
    for (round, swapped) in swapped.iter_mut().enumerate() {
        for theme in themes.all().iter().map(Some).chain([None]) {
            figure.theme = theme.map(|theme| theme.name.clone());
            let swap = ask(&figure, false);
            std::thread::sleep(REST);
            let mut turns: Vec<f64> = Vec::new();
            for _ in 0..3 {
                figure.camera.from[0] += 0.01;
                turns.push(ask(&figure, false));
                std::thread::sleep(REST / 10);
            }
            turns.sort_by(f64::total_cmp);
            let name = figure.theme.as_deref().unwrap_or("none");
            println!("round {round} {name:>18}: {swap:6.0} ms, a turn {:6.0} ms", turns[1]);
            swapped.push(swap);
            turned.extend(turns);
        }
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    println!(
        "median of {}: first swaps {:.0} ms, longest {:.0}",
        swapped[0].len(),
        median(&mut swapped[0]),
        swapped[0].iter().fold(0.0, |a: f64, b| a.max(*b))
    );
    println!("median of {}: later swaps {:.0} ms", swapped[1].len(), median(&mut swapped[1]));
    println!("median of {}: turns {:.0} ms", turned.len(), median(&mut turned));
}
