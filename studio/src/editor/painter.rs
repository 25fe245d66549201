//! The painter: a thread that owns the adapter and draws whatever figure was asked for last, coarse first, then finer. The
//! window never waits for it: it asks, and polls for what has come.
//!
//! It has a device of its own, apart from the window's: nothing that it draws can hold the window up, a lost device is its
//! own affair, and new pipelines compile here.

use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};
use std::panic::AssertUnwindSafe;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Result;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::progress::Progress;
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::scene::{Background, Quality, Scene};
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::styles::pattern::Pattern;
use fabrica_engine::volume::Volume;
use fabrica_engine::{color, estimate};

use super::files::is_cancelled;
use super::wording;
use crate::figure::sources::Sources;
use crate::figure::theme::{Themes, Wardrobe};
use crate::figure::{Template, bridge};

/// A figure to draw.
#[derive(Clone)]
pub struct Request {
    /// What is drawn.
    pub figure: Arc<Template>,
    /// What was read for its slots.
    pub sources: Sources,
    /// Pixels of the whole picture.
    pub size: [u32; 2],
    /// A button is down: nothing but the coarse picture is wanted.
    pub coarse_only: bool,
    /// It shows what a brush has just done.
    pub is_painted: bool,
}

/// How far a picture is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage {
    /// A few of its pixels, in haste.
    Coarse,
    /// All pixels, at draft quality or partly finer: share of the rows that are done.
    Refining(f32),
    /// As it will be exported, but for its size.
    Refined {
        /// From the request on.
        seconds: f32,
    },
    /// It cannot be drawn; what is shown is older.
    Failed,
    /// It was stopped on the way.
    Stopped,
}

/// What the painter has to say.
pub enum Update {
    /// The adapter is open.
    Ready {
        /// Its name.
        adapter: String,
        /// The longest axis of a volume that it takes, in voxels.
        edge: usize,
    },
    /// Rows of a picture, sRGB with opaque pixels.
    Rows {
        /// Of the request that they belong to.
        number: u64,
        /// Columns and rows of the picture: fewer than asked for while it is coarse. Less than all of its rows go into the
        /// picture of this size that came last.
        size: [usize; 2],
        /// The first of these rows.
        y: usize,
        /// How many they are.
        num_rows: usize,
        /// RGBA.
        pixels: Vec<u8>,
        /// How far it is.
        stage: Stage,
    },
    /// The estimated error of a picture that is finished (99.9 % of its pixels), in 8-bit codes.
    Estimated {
        /// Of the request that it belongs to.
        number: u64,
        /// The estimate.
        codes: f64,
    },
    /// The device was lost; another one takes its place.
    Restarted,
    /// It was stopped, or given up for a later request.
    Stopped {
        /// Of the request that it belongs to.
        number: u64,
    },
    /// The figure cannot be drawn: one sentence.
    Failed {
        /// Of the request that it belongs to.
        number: u64,
        /// Why.
        message: String,
    },
}

#[derive(Default)]
struct Desk {
    /// What figures can be dressed in.
    styles: Arc<StyleLibrary>,
    /// The last request that nobody has begun yet.
    request: Option<(u64, Request)>,
    /// What may be asked for next: drawn very small while there is no request, so that what it needs is compiled.
    likely: Vec<Request>,
    /// Cancels what is being drawn.
    current: Option<Progress>,
    /// The volumes of what is being drawn.
    volumes: Vec<Arc<Volume>>,
    /// Whether the coarse picture of that is there.
    is_refining: bool,
    /// The number of the last request.
    number: u64,
    closed: bool,
    /// The device is to be lost before the next picture: a test of what follows.
    lose_device: bool,
}

/// The thread's handle. Dropping it ends the thread.
pub struct Painter {
    desk: Arc<(Mutex<Desk>, Condvar)>,
    updates: Receiver<Update>,
    thread: Option<JoinHandle<()>>,
}

/// The time that a coarse picture may take.
const COARSE: Duration = Duration::from_millis(50);
/// A coarse picture in the middle of a stroke draws so many times fewer pixels: a hand that paints looks at what it has just done.
const HURRY: f64 = 2.5;
/// The time that one submission to the adapter is to take: what else it does, the window's own frames too, waits as long.
const SUBMISSION: Duration = Duration::from_millis(8);
/// Edges of tiles, which are what is submitted, cancelled and shown at once.
const TILES: (u32, u32) = (32, 256);

/// Steps of coarse pictures, in voxels: longer ones leave holes in thin bone, but let translucent figures have more pixels.
const STEPS: (f64, f64) = (2.0, 8.0);
/// Strides of coarse pictures beyond which the step changes rather than the stride.
const STRIDES: (f64, f64) = (3.0, 5.5);

/// How the work is cut, as it follows from how long it took so far.
struct Pace {
    /// Of this many pixels, across and down, a coarse picture draws one.
    stride: u32,
    /// Its step, in voxels.
    step: f64,
    /// Edge of a tile of a whole picture.
    tile: u32,
}

impl Pace {
    /// What a request's coarse picture leaves out.
    fn coarse_stride(&self, request: &Request) -> u32 {
        let hurry = if request.coarse_only && request.is_painted { HURRY } else { 1.0 };
        (f64::from(self.stride) * hurry.sqrt()).round() as u32
    }

    /// A coarse picture took `time` that was drawn at `stride`.
    fn coarse_took(&mut self, time: Duration, stride: u32) {
        let share = f64::from(stride).powi(2) / f64::from(self.stride).powi(2);
        let ratio = share * time.as_secs_f64() / COARSE.as_secs_f64();
        let mut stride = f64::from(self.stride) * ratio.sqrt();
        if stride > STRIDES.1 && self.step < STEPS.1 {
            (self.step, stride) = (2.0 * self.step, stride * FRAC_1_SQRT_2);
        } else if stride < STRIDES.0 && self.step > STEPS.0 {
            (self.step, stride) = (0.5 * self.step, stride * SQRT_2);
        }
        self.stride = (stride.ceil() as u32).clamp(2, 16);
    }

    /// The coarse picture's quality: it looks once at a style, whatever its normal does, and stops early.
    fn coarse(&self) -> Quality {
        Quality { step_voxels: self.step, style_change: 100.0, termination: 1.0 / 64.0, ..Quality::DRAFT }
    }

    /// `num_tiles` tiles took `time`.
    fn tiles_took(&mut self, num_tiles: u32, time: Duration) {
        let ratio = SUBMISSION.as_secs_f64() * f64::from(num_tiles) / time.as_secs_f64().max(1e-6);
        let edge = f64::from(self.tile) * ratio.sqrt();
        self.tile = ((edge / 32.0).round() as u32 * 32).clamp(TILES.0, TILES.1);
    }

    fn num_tiles(&self, size: [u32; 2]) -> u32 {
        size[0].div_ceil(self.tile) * size[1].div_ceil(self.tile)
    }
}

impl Painter {
    /// Starts the thread; `wake` is called, there, whenever there is an update.
    pub fn start(
        choice: AdapterChoice,
        styles: Arc<StyleLibrary>,
        themes: Arc<Themes>,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let desk = Arc::new((Mutex::new(Desk { styles, ..Desk::default() }), Condvar::new()));
        let (sender, updates) = channel();
        let theirs = desk.clone();
        let thread = std::thread::spawn(move || {
            let tell = |update| {
                // Nobody listens any more when the window is closing.
                let _ = sender.send(update);
                wake();
            };
            paint(&theirs, &choice, &themes, &tell);
        });
        Self { desk, updates, thread: Some(thread) }
    }

    /// Asks for a figure; what was asked for before is given up, but for a coarse picture of the same volumes that is on its way: were
    /// it cancelled by each of the requests of a hand that never rests, none would ever be seen. The number that its updates will carry.
    pub fn ask(&self, request: Request) -> u64 {
        let (desk, bell) = &*self.desk;
        let mut desk = desk.lock().unwrap_or_else(PoisonError::into_inner);
        desk.number += 1;
        let number = desk.number;
        let same = |(a, b): (&Arc<Volume>, &Arc<Volume>)| Arc::ptr_eq(a, b);
        let is_same = desk.volumes.iter().zip(&request.sources.volumes).all(same);
        desk.request = Some((number, request));
        if let Some(current) = desk.current.as_ref().filter(|_| desk.is_refining || !is_same) {
            current.cancel();
        }
        bell.notify_one();
        number
    }

    /// Gets ready for figures of which one may be asked for next: compiling a shader takes a software adapter up to seconds. They wait
    /// behind every request, and none of their pictures is shown.
    pub fn expect(&self, mut figures: Vec<Request>) {
        let (desk, bell) = &*self.desk;
        // The last is taken first.
        figures.reverse();
        desk.lock().unwrap_or_else(PoisonError::into_inner).likely = figures;
        bell.notify_one();
    }

    /// What is asked for from now on may be dressed in these.
    pub fn set_styles(&self, styles: Arc<StyleLibrary>) {
        self.desk.0.lock().unwrap_or_else(PoisonError::into_inner).styles = styles;
    }

    /// Gives up what is being drawn.
    pub fn stop(&self) {
        if let Some(current) = &self.desk.0.lock().unwrap_or_else(PoisonError::into_inner).current {
            current.cancel();
        }
    }

    /// Loses the device before the next picture, as a driver's reset would: for tests of what follows.
    pub fn lose_device(&self) {
        self.desk.0.lock().unwrap_or_else(PoisonError::into_inner).lose_device = true;
    }

    /// What has come since the last time.
    pub fn updates(&self) -> impl Iterator<Item = Update> + '_ {
        self.updates.try_iter()
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        {
            let (desk, bell) = &*self.desk;
            let mut desk = desk.lock().unwrap_or_else(PoisonError::into_inner);
            desk.closed = true;
            if let Some(current) = &desk.current {
                current.cancel();
            }
            bell.notify_one();
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn paint(desk: &(Mutex<Desk>, Condvar), choice: &AdapterChoice, themes: &Themes, tell: &dyn Fn(Update)) {
    let mut renderer: Option<Renderer> = None;
    let mut pace = Pace { stride: 4, step: STEPS.0, tile: 128 };
    // What the likely figures before had: those that have the same need the same shader.
    let mut expected: Vec<Features> = Vec::new();
    loop {
        let (number, request, styles, progress) = {
            let (lock, bell) = desk;
            let mut desk = lock.lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                if desk.closed {
                    return;
                }
                if let Some((number, request)) = desk.request.take() {
                    let progress = Progress::new();
                    desk.current = Some(progress.clone());
                    desk.volumes.clone_from(&request.sources.volumes);
                    desk.is_refining = false;
                    if std::mem::take(&mut desk.lose_device)
                        && let Some(renderer) = &renderer
                    {
                        renderer.context().device.destroy();
                    }
                    expected.clear();
                    break (Some(number), request, desk.styles.clone(), progress);
                }
                if let Some(request) = desk.likely.pop() {
                    let progress = Progress::new();
                    desk.current = Some(progress.clone());
                    // A request cancels it.
                    desk.is_refining = true;
                    break (None, request, desk.styles.clone(), progress);
                }
                desk.current = None;
                desk.volumes.clear();
                desk = bell.wait(desk).unwrap_or_else(PoisonError::into_inner);
            }
        };
        let wardrobe = Wardrobe { styles: &styles, themes };
        let Some(number) = number else {
            if let Some(renderer) = &mut renderer {
                // What cannot be drawn says so when it is asked for.
                let work = AssertUnwindSafe(|| expect(renderer, &request, wardrobe, &mut expected, &progress));
                let _ = std::panic::catch_unwind(work);
            }
            continue;
        };
        let tell_drawn = |update: Update| {
            let is_coarse = matches!(update, Update::Rows { stage: Stage::Coarse, .. });
            tell(update);
            if is_coarse {
                // From here on a new request cancels it, also one that has come meanwhile.
                let mut desk = desk.0.lock().unwrap_or_else(PoisonError::into_inner);
                desk.is_refining = true;
                if desk.request.is_some() {
                    progress.cancel();
                }
            }
        };
        let mut once = |renderer: &mut Option<Renderer>| {
            let work = AssertUnwindSafe(|| {
                open(renderer, choice, tell)
                    .and_then(|renderer| draw(renderer, number, &request, wardrobe, &mut pace, &progress, &tell_drawn))
            });
            // wgpu's helpers panic where a device is lost between two calls. The window must not lose its painter by that.
            std::panic::catch_unwind(work).unwrap_or_else(|_| {
                Err(anyhow::anyhow!("the graphics device failed while drawing; change something to try again"))
            })
        };
        let mut outcome = once(&mut renderer);
        if outcome.is_err() && renderer.as_ref().is_some_and(|r| r.context().is_lost()) {
            // The volume goes to a new device, and the picture is begun again.
            renderer = None;
            tell(Update::Restarted);
            outcome = once(&mut renderer);
        }
        match outcome {
            Ok(()) => {}
            Err(error) if is_cancelled(&error) => tell(Update::Stopped { number }),
            Err(error) => tell(Update::Failed { number, message: wording::sentence(&error) }),
        }
    }
}

/// What of an object decides, for one figure in several themes, which shader draws it: contours, illustrative transparency, light,
/// patterns and whether these follow the curvature.
type Features = [bool; 5];

/// Pixels a side of a picture that is drawn to have its shader compiled.
const TINY: u32 = 8;

/// Draws a figure so small that nothing but compiling its shader takes time.
fn expect(
    renderer: &mut Renderer,
    request: &Request,
    wardrobe: Wardrobe<'_>,
    expected: &mut Vec<Features>,
    progress: &Progress,
) -> Result<()> {
    let (scene, _) = bridge::scene(&request.figure, &request.sources, wardrobe, progress)?;
    let Some(object) = scene.objects.first() else { return Ok(()) };
    let features = [
        object.has_contours(),
        object.has_illustrative_transparency(),
        object.lighting.is_some(),
        scene.has_patterns(object),
        scene.patterns(object).any(Pattern::follows_curvature),
    ];
    if !expected.contains(&features) {
        let tiny = Scene { quality: Quality::DRAFT, ..scene.clone() };
        renderer.render(&tiny, [TINY; 2], &RenderOptions::default(), progress)?;
        expected.push(features);
    }
    Ok(())
}

fn open<'a>(
    renderer: &'a mut Option<Renderer>,
    choice: &AdapterChoice,
    tell: &dyn Fn(Update),
) -> Result<&'a mut Renderer> {
    Ok(match renderer {
        Some(renderer) => renderer,
        none => {
            let context = GpuContext::new(choice)?;
            let (adapter, edge) = (context.adapter.name.clone(), context.adapter.max_volume_edge as usize);
            tell(Update::Ready { adapter, edge });
            none.insert(Renderer::new(context))
        }
    })
}

fn draw(
    renderer: &mut Renderer,
    number: u64,
    request: &Request,
    wardrobe: Wardrobe<'_>,
    pace: &mut Pace,
    progress: &Progress,
    tell: &dyn Fn(Update),
) -> Result<()> {
    let start = Instant::now();
    let (scene, _) = bridge::scene(&request.figure, &request.sources, wardrobe, progress)?;
    let draft = Scene { quality: Quality::DRAFT, ..scene.clone() };
    let rows = |size: [u32; 2], y: u32, pixels: &[[f32; 4]], stage| {
        let (size, y) = (size.map(|n| n as usize), y as usize);
        let num_rows = pixels.len() / size[0];
        let pixels = opaque_srgb(y, size[0], pixels, scene.background);
        tell(Update::Rows { number, size, y, num_rows, pixels, stage });
    };
    // Coarse: of every `stride`² pixels one.
    let stride = pace.coarse_stride(request);
    // At once, as large as it is.
    let at_once = RenderOptions { tile: 4096, tile_ms: f64::INFINITY, ..RenderOptions::default() };
    let options = RenderOptions { stride, ..at_once };
    let coarse = Instant::now();
    let hasty = Scene { quality: pace.coarse(), ..draft.clone() };
    let image = renderer.render(&hasty, request.size, &options, progress)?;
    pace.coarse_took(coarse.elapsed(), stride);
    rows([image.width, image.height], 0, &image.pixels, Stage::Coarse);
    if request.coarse_only {
        return Ok(());
    }
    // All pixels at draft quality, then again at the figure's, row of tiles by row of tiles.
    let options = RenderOptions { tile: pace.tile, ..at_once };
    let begun = Instant::now();
    let whole = renderer.render(&draft, request.size, &options, progress)?;
    pace.tiles_took(pace.num_tiles(request.size), begun.elapsed());
    let done = |num_rows: u32| {
        if num_rows < request.size[1] {
            Stage::Refining(num_rows as f32 / request.size[1] as f32)
        } else {
            Stage::Refined { seconds: start.elapsed().as_secs_f32() }
        }
    };
    if scene.quality == draft.quality {
        rows(request.size, 0, &whole.pixels, done(request.size[1]));
    } else {
        rows(request.size, 0, &whole.pixels, done(0));
        let begun = Instant::now();
        let mut y = 0;
        renderer.render_bands(&scene, request.size, &options, progress, |band| {
            let num_rows = band.len() as u32 / request.size[0];
            rows(request.size, y, band, done(y + num_rows));
            y += num_rows;
            Ok(())
        })?;
        pace.tiles_took(pace.num_tiles(request.size), begun.elapsed());
    }
    // What is finished is judged, while nothing else is wanted.
    // The picture is there even if it cannot be, or if the next request is quicker.
    if let Ok(estimate) = estimate::of_quality(renderer, &scene, request.size, progress) {
        tell(Update::Estimated { number, codes: estimate.codes });
    }
    Ok(())
}

/// Edge of a square of the checkerboard behind transparent figures, in pixels, and its two grays (linear).
const CHECKER: (usize, [f32; 2]) = (8, [0.55, 0.75]);

/// RGBA bytes of the rows of a picture from `y` on, transparent ones over a checkerboard.
fn opaque_srgb(y: usize, width: usize, pixels: &[[f32; 4]], background: Background) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(4 * pixels.len());
    for (i, pixel) in pixels.iter().enumerate() {
        let behind = match background {
            Background::Color(_) => 0.0,
            Background::Transparent => {
                let square = (i % width / CHECKER.0 + (y + i / width) / CHECKER.0) % 2;
                (1.0 - pixel[3]) * CHECKER.1[square]
            }
        };
        bytes.extend([0, 1, 2].map(|c| color::srgb8_from_linear(pixel[c] + behind)));
        bytes.push(255);
    }
    bytes
}
