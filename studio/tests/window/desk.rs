//! A desk with the studio on it: the display, the program in a home of its own, and the folder where a person finds what was
//! seen.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use x11rb::protocol::xproto::Window;

use crate::display::{Button, Display, Place, SIZE};
use crate::picture::{Picture, Region};

/// Codes of the test figures' background, which nothing else in the window has: where it is, the figure is.
pub const BACKGROUND: [u8; 3] = [0x2a, 0x5a, 0x48];

/// Width of the panel at the right.
const PANEL: usize = 300;

/// However slow the machine: what has not happened by then will not.
const DEADLINE: Duration = Duration::from_secs(60);

/// Pixels that are more than a hand trembles in a click (egui: 6).
const WIGGLE: i16 = 8;

/// How often one looks.
const LOOK: Duration = Duration::from_millis(50);

/// Display, program and pictures of a test.
pub struct Desk {
    pub display: Display,
    program: Option<Child>,
    home: tempfile::TempDir,
    pictures: PathBuf,
    num_pictures: usize,
}

impl Desk {
    /// A desk without a program; its pictures go into a folder of the test's name.
    pub fn new(test: &str) -> Self {
        let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("window").join(test);
        let _ = std::fs::remove_dir_all(&pictures);
        std::fs::create_dir_all(&pictures).unwrap();
        println!("pictures: {}", pictures.display());
        let home = tempfile::tempdir().unwrap();
        Self { display: Display::start(), program: None, home, pictures, num_pictures: 0 }
    }

    /// The program with nothing of this machine's or this user's state.
    fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fabrica"));
        for name in ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "XMODIFIERS", "XAUTHORITY", "RUST_LOG"] {
            command.env_remove(name);
        }
        let folders = [
            ("HOME", "home"),
            ("XDG_CONFIG_HOME", "config"),
            ("XDG_DATA_HOME", "data"),
            ("XDG_STATE_HOME", "state"),
            ("XDG_CACHE_HOME", "cache"),
            ("XDG_RUNTIME_DIR", "run"),
            ("FABRICA_STATE", "studio-state"),
            ("FABRICA_CACHE", "studio-cache"),
        ];
        for (name, folder) in folders {
            let folder = self.home.path().join(folder);
            std::fs::create_dir_all(&folder).unwrap();
            command.env(name, folder);
        }
        // One pixel a point, as in the layout's twin.
        command.env("DISPLAY", self.display.name()).env("WINIT_X11_SCALE_FACTOR", "1").stdin(Stdio::null());
        command
    }

    /// Opens a figure in the window and waits for both.
    pub fn open(&mut self, figure: &Path) -> Window {
        assert!(self.program.is_none(), "one program at a time");
        let log = File::create(self.log()).unwrap();
        let mut command = self.command();
        command.arg("open").arg(figure).args(["--adapter", "software"]);
        self.program = Some(command.stdout(log.try_clone().unwrap()).stderr(log).spawn().unwrap());
        let window = self.until("the window", |desk| desk.display.window().ok_or_else(|| "not shown".to_owned()));
        let [width, height] = SIZE.map(i32::from);
        assert_eq!(self.display.rectangle(window), [0, 0, width, height], "the window is not where its twin is");
        self.display.focus(window);
        self.until("a first picture", |desk| desk.picture().map(|_| ()));
        window
    }

    /// Waits until something is so; otherwise fails with what was said last and a picture of it.
    pub fn until<T>(&mut self, what: &str, mut look: impl FnMut(&mut Self) -> Result<T, String>) -> T {
        let start = Instant::now();
        loop {
            let said = match look(self) {
                Ok(value) => return value,
                Err(said) => said,
            };
            let ended = self.program.as_mut().and_then(|p| p.try_wait().unwrap());
            if ended.is_some() || start.elapsed() > DEADLINE {
                let program =
                    ended.map_or("the program runs".to_owned(), |status| format!("the program ended, {status}"));
                panic!("waiting for {what} ({:.0} s): {said}; {program}", start.elapsed().as_secs_f32());
            }
            assert!(self.display.is_alive(), "waiting for {what}: Xvfb ended");
            std::thread::sleep(LOOK);
        }
    }

    /// Where the figure is in the window.
    pub fn frame(&self) -> Result<Region, String> {
        let seen = self.display.screenshot();
        // The panel at the right shows the background's color, too.
        let [width, height] = SIZE.map(usize::from);
        let beside = Region { left: 0, top: 0, width: width - PANEL, height };
        seen.crop(beside).bounds_of(BACKGROUND).ok_or_else(|| "no figure is seen".to_owned())
    }

    /// The figure as the window shows it now.
    pub fn picture(&self) -> Result<Picture, String> {
        let frame = self.frame()?;
        Ok(self.display.screenshot().crop(frame))
    }

    /// Waits until the window shows a figure as `fabrica render` writes it, to the last pixel; that picture.
    pub fn until_drawn(&mut self, figure: &Path) -> Picture {
        let frame = self.until("the figure's frame", |desk| desk.frame());
        let expected = self.render(figure, [frame.width, frame.height]);
        self.until_shown(&format!("{} as `fabrica render` writes it", figure.display()), &expected);
        expected
    }

    /// Waits until the window shows a picture, to the last pixel.
    pub fn until_shown(&mut self, what: &str, expected: &Picture) {
        expected.save(&self.pictures.join("expected.png"));
        self.until(what, |desk| desk.picture()?.difference(expected).map_or(Ok(()), Err));
    }

    /// Waits until a part of the display is no longer as it was.
    pub fn until_changed(&mut self, what: &str, region: Region, before: &Picture) {
        let before = before.crop(region);
        self.until(what, |desk| {
            let now = desk.display.screenshot().crop(region);
            now.difference(&before).map(|_| ()).ok_or_else(|| format!("nothing has changed in {region:?}"))
        });
    }

    /// A figure as the command line draws it.
    fn render(&self, figure: &Path, size: [usize; 2]) -> Picture {
        let out = self.home.path().join("rendered.png");
        let size = format!("{}x{}", size[0], size[1]);
        let mut command = self.command();
        command.arg("render").arg(figure).args(["--adapter", "software", "--size", &size, "--out"]).arg(&out);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Picture::read(&out)
    }

    /// Drags across the figure with a button at a hand's pace, once the window has begun to follow: to a busy machine, a press
    /// and a release that come in one frame are neither a drag nor a click.
    pub fn drag(&mut self, button: Button, from: Place, to: Place) {
        const PARTS: i16 = 12;
        self.display.move_to(from);
        let last = self.picture();
        self.display.press(button);
        self.wiggle(from, last);
        for part in 1..=PARTS {
            let along = |i: usize| from[i] + (i32::from(to[i] - from[i]) * i32::from(part) / i32::from(PARTS)) as i16;
            self.display.move_to([along(0), along(1)]);
            std::thread::sleep(Duration::from_millis(15));
        }
        self.display.release(button);
    }

    /// Moves to and fro, farther than within a click, until the figure's picture is another one.
    fn wiggle(&mut self, at: Place, last: Result<Picture, String>) {
        let mut looks = 0;
        self.until("the figure to follow", |desk| {
            looks += 1;
            desk.display.move_to([at[0] + looks % 2 * WIGGLE, at[1]]);
            if desk.picture() == last { Err("no new picture".to_owned()) } else { Ok(()) }
        });
        self.display.move_to(at);
    }

    /// Drags something that goes along with the pointer, as a style does, from one widget to another. Of a press and a move in
    /// one frame, egui takes the press to be where the move ended: so the hand first waits until it has it.
    pub fn carry(&mut self, from: Place, to: Place) {
        let beside = |[left, top]: Place| Region { left: left as usize, top: top as usize, width: 24, height: 24 };
        let resting = self.display.screenshot();
        self.display.move_to(from);
        self.until_changed("the pointer to arrive", beside(from), &resting);
        let before = self.display.screenshot();
        self.display.press(Button::Left);
        let mut looks = 0;
        let near = before.crop(beside(from));
        self.until("the hand to have it", |desk| {
            looks += 1;
            desk.display.move_to([from[0] + looks % 2 * WIGGLE, from[1]]);
            if desk.display.screenshot().crop(beside(from)) == near { Err("nothing moves".to_owned()) } else { Ok(()) }
        });
        for part in 1..=8 {
            let along = |i: usize| from[i] + (i32::from(to[i] - from[i]) * part / 8) as i16;
            self.display.move_to([along(0), along(1)]);
            std::thread::sleep(Duration::from_millis(30));
        }
        self.until_changed("what is carried to arrive", beside(to), &before);
        self.display.release(Button::Left);
    }

    /// Keeps a picture of the display for people.
    pub fn keep(&mut self, name: &str) -> Picture {
        self.num_pictures += 1;
        let picture = self.display.screenshot();
        picture.save(&self.pictures.join(format!("{:02}-{name}.png", self.num_pictures)));
        picture
    }

    /// As [`Desk::keep`], once nothing fades or refines any more. That is for the eye: no test may rest on it.
    pub fn keep_still(&mut self, name: &str) -> Picture {
        let mut last = self.display.screenshot();
        for _ in 0..6 {
            std::thread::sleep(8 * LOOK);
            let now = self.display.screenshot();
            if now == last {
                break;
            }
            last = now;
        }
        self.keep(name)
    }

    /// Waits for the program's end; its exit code.
    pub fn exit_code(&mut self) -> Option<i32> {
        let mut program = self.program.take().unwrap();
        let start = Instant::now();
        loop {
            if let Some(status) = program.try_wait().unwrap() {
                return status.code();
            }
            if start.elapsed() > DEADLINE {
                self.program = Some(program);
                panic!("the program does not end");
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Whether the program still runs.
    pub fn is_running(&mut self) -> bool {
        self.program.as_mut().is_some_and(|p| p.try_wait().unwrap().is_none())
    }

    /// What the program said.
    fn log(&self) -> PathBuf {
        self.pictures.join("program.log")
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        if std::thread::panicking() {
            if self.display.is_alive() {
                self.keep("failed");
            }
            let log = std::fs::read_to_string(self.log()).unwrap_or_default();
            eprintln!("last picture: {}/{:02}-failed.png", self.pictures.display(), self.num_pictures);
            eprintln!("the program said: {}", if log.is_empty() { "nothing" } else { log.trim_end() });
        }
        if let Some(mut program) = self.program.take() {
            let _ = program.kill();
            let _ = program.wait();
        }
    }
}
