//! The painter: a thread that owns the adapter and draws whatever figure was asked for last, coarse first, then finer. The
//! window never waits for it: it asks, and polls for what has come.
//!
//! It has a device of its own, apart from the window's: nothing that it draws can hold the window up, a lost device is its
//! own affair, and new pipelines compile here.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Result;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::progress::Progress;
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer, sampled_size};
use fabrica_engine::scene::{Background, Quality, Scene};
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::volume::Volume;
use fabrica_engine::{Error, color};

use crate::figure::{Template, bridge};

/// A figure to draw.
#[derive(Clone)]
pub struct Request {
    /// What is drawn.
    pub figure: Arc<Template>,
    /// The volumes in its slots.
    pub volumes: Vec<Arc<Volume>>,
    /// Pixels of the whole picture.
    pub size: [u32; 2],
    /// A button is down: nothing but the coarse picture is wanted.
    pub coarse_only: bool,
}

/// How far a picture is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage {
    /// A few of its pixels, at draft quality.
    Coarse,
    /// All pixels, at draft quality or partly finer: share of the rows that are done.
    Refining(f32),
    /// As it will be exported, but for its size.
    Refined {
        /// From the request on.
        seconds: f32,
    },
}

/// What the painter has to say.
pub enum Update {
    /// The adapter is open: its name.
    Ready(String),
    /// A picture, sRGB with opaque pixels, row by row from the top.
    Picture {
        /// Of the request that it belongs to.
        number: u64,
        /// Columns and rows; fewer than asked for while it is coarse.
        size: [usize; 2],
        /// RGBA.
        pixels: Vec<u8>,
        /// How far it is.
        stage: Stage,
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
    /// The last request that nobody has begun yet.
    request: Option<(u64, Request)>,
    /// Cancels what is being drawn.
    current: Option<Progress>,
    /// The number of the last request.
    number: u64,
    closed: bool,
}

/// The thread's handle. Dropping it ends the thread.
pub struct Painter {
    desk: Arc<(Mutex<Desk>, Condvar)>,
    updates: Receiver<Update>,
    thread: Option<JoinHandle<()>>,
}

/// The time that a coarse picture may take.
const COARSE: Duration = Duration::from_millis(70);
/// Rows of tiles, and with them what is cancelled and shown at once.
const TILE: u32 = 128;

impl Painter {
    /// Starts the thread; `wake` is called, there, whenever there is an update.
    pub fn start(choice: AdapterChoice, styles: StyleLibrary, wake: impl Fn() + Send + 'static) -> Self {
        let desk = Arc::new((Mutex::new(Desk::default()), Condvar::new()));
        let (sender, updates) = channel();
        let theirs = desk.clone();
        let thread = std::thread::spawn(move || {
            let tell = |update| {
                // Nobody listens any more when the window is closing.
                let _ = sender.send(update);
                wake();
            };
            paint(&theirs, &choice, &styles, &tell);
        });
        Self { desk, updates, thread: Some(thread) }
    }

    /// Asks for a figure; what was asked for before is given up. The number that its updates will carry.
    pub fn ask(&self, request: Request) -> u64 {
        let (desk, bell) = &*self.desk;
        let mut desk = desk.lock().unwrap_or_else(PoisonError::into_inner);
        desk.number += 1;
        let number = desk.number;
        desk.request = Some((number, request));
        if let Some(current) = &desk.current {
            current.cancel();
        }
        bell.notify_one();
        number
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

fn paint(desk: &(Mutex<Desk>, Condvar), choice: &AdapterChoice, styles: &StyleLibrary, tell: &dyn Fn(Update)) {
    let mut renderer: Option<Renderer> = None;
    let mut stride = 4;
    loop {
        let (number, request, progress) = {
            let (lock, bell) = desk;
            let mut desk = lock.lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                if desk.closed {
                    return;
                }
                if let Some((number, request)) = desk.request.take() {
                    let progress = Progress::new();
                    desk.current = Some(progress.clone());
                    break (number, request, progress);
                }
                desk.current = None;
                desk = bell.wait(desk).unwrap_or_else(PoisonError::into_inner);
            }
        };
        let outcome = open(&mut renderer, choice, tell)
            .and_then(|renderer| draw(renderer, number, &request, styles, &mut stride, &progress, tell));
        if let Err(error) = outcome {
            match error.downcast_ref::<Error>() {
                Some(Error::Cancelled) => continue,
                // A lost device is opened anew with the next request.
                Some(Error::Gpu { .. }) => renderer = None,
                _ => {}
            }
            tell(Update::Failed { number, message: format!("{error:#}") });
        }
    }
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
            tell(Update::Ready(context.adapter.name.clone()));
            none.insert(Renderer::new(context))
        }
    })
}

fn draw(
    renderer: &mut Renderer,
    number: u64,
    request: &Request,
    styles: &StyleLibrary,
    stride: &mut u32,
    progress: &Progress,
    tell: &dyn Fn(Update),
) -> Result<()> {
    let start = Instant::now();
    let (scene, _) = bridge::scene(&request.figure, &request.volumes, styles, progress)?;
    let draft = Scene { quality: Quality::DRAFT, ..scene.clone() };
    let picture = |image: &FloatImage, stage| Update::Picture {
        number,
        size: [image.width as usize, image.height as usize],
        pixels: opaque_srgb(image, scene.background),
        stage,
    };
    // Coarse: of every `stride`² pixels one. The stride follows the time that the last one took.
    let options = RenderOptions { stride: *stride, tile: 4096, ..RenderOptions::default() };
    let coarse = Instant::now();
    let image = renderer.render(&draft, request.size, &options, progress)?;
    let ratio = coarse.elapsed().as_secs_f64() / COARSE.as_secs_f64();
    *stride = ((f64::from(*stride) * ratio.sqrt()).ceil() as u32).clamp(2, 16);
    tell(picture(&image, Stage::Coarse));
    if request.coarse_only {
        return Ok(());
    }
    // All pixels at draft quality, then again at the figure's, row of tiles by row of tiles.
    let options = RenderOptions { tile: TILE, ..RenderOptions::default() };
    let mut whole = renderer.render(&draft, request.size, &options, progress)?;
    tell(picture(&whole, Stage::Refining(0.0)));
    if scene.quality != draft.quality {
        let [width, height] = sampled_size(request.size, 1);
        let mut done = 0;
        renderer.render_bands(&scene, request.size, &options, progress, |band| {
            whole.pixels[done..done + band.len()].copy_from_slice(band);
            done += band.len();
            if done < whole.pixels.len() {
                tell(picture(&whole, Stage::Refining(done as f32 / (width * height) as f32)));
            }
            Ok(())
        })?;
    }
    tell(picture(&whole, Stage::Refined { seconds: start.elapsed().as_secs_f32() }));
    Ok(())
}

/// Edge of a square of the checkerboard behind transparent figures, in pixels, and its two grays (linear).
const CHECKER: (usize, [f32; 2]) = (8, [0.55, 0.75]);

/// RGBA bytes of a picture, transparent ones over a checkerboard.
fn opaque_srgb(image: &FloatImage, background: Background) -> Vec<u8> {
    let width = image.width as usize;
    let mut bytes = Vec::with_capacity(4 * image.pixels.len());
    for (i, pixel) in image.pixels.iter().enumerate() {
        let behind = match background {
            Background::Color(_) => 0.0,
            Background::Transparent => {
                let square = (i % width / CHECKER.0 + i / width / CHECKER.0) % 2;
                (1.0 - pixel[3]) * CHECKER.1[square]
            }
        };
        bytes.extend([0, 1, 2].map(|c| color::srgb8_from_linear(pixel[c] + behind)));
        bytes.push(255);
    }
    bytes
}

/// Volumes that are being read, on a thread of their own.
pub struct Loading {
    /// What is read.
    pub path: PathBuf,
    /// To be polled and cancelled.
    pub progress: Progress,
    result: Receiver<Result<Loaded>>,
}

/// A figure with its volumes.
pub struct Loaded {
    /// The figure.
    pub figure: Template,
    /// One a slot; empty if they could not be read.
    pub volumes: Vec<Arc<Volume>>,
    /// What the user shall know, a sentence each.
    pub notes: Vec<String>,
}

impl Loading {
    /// Begins to read with `read`; `wake` is called at the end.
    pub fn start(
        path: PathBuf,
        read: impl FnOnce(&Progress) -> Result<Loaded> + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let progress = Progress::new();
        let (sender, result): (Sender<Result<Loaded>>, _) = channel();
        let theirs = progress.clone();
        std::thread::spawn(move || {
            let _ = sender.send(read(&theirs));
            wake();
        });
        Self { path, progress, result }
    }

    /// The outcome, once.
    pub fn finished(&self) -> Option<Result<Loaded>> {
        self.result.try_recv().ok()
    }
}
