//! A display of the test's own: an X server that draws into memory, and a hand on its mouse and keyboard. No window manager
//! runs on it, so the test says which window has the keys.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};

use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::{
    self, ClientMessageEvent, ConnectionExt as _, EventMask, ImageFormat, InputFocus, MapState, Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

use crate::picture::Picture;

/// Pixels of the display, and of the studio's window, which covers it.
pub const SIZE: [u16; 2] = [1280, 800];

/// A place on the display, pixels from the upper left corner.
pub type Place = [i16; 2];

/// Buttons of the mouse as X counts them; the wheel's notches are buttons too.
#[derive(Clone, Copy, Debug)]
#[expect(dead_code, reason = "a hand has all of them, whether or not a test needs them")]
pub enum Button {
    Left = 1,
    Middle = 2,
    Right = 3,
    WheelUp = 4,
    WheelDown = 5,
}

/// Keys that write nothing: X's keysyms.
pub mod key {
    pub const SHIFT: u32 = 0xffe1;
    pub const CONTROL: u32 = 0xffe3;
    pub const ENTER: u32 = 0xff0d;
}

/// The X server; it ends with this.
pub struct Display {
    name: String,
    connection: RustConnection,
    root: Window,
    /// Keysyms per key, key after key from `first_key` on; the second of each is what Shift makes of it.
    keysyms: Vec<u32>,
    keysyms_per_key: usize,
    first_key: u8,
    server: Server,
}

/// Kills the server also where a test panics before the display is whole.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Display {
    /// Starts a server on a free display.
    pub fn start() -> Self {
        let screen = format!("{}x{}x24", SIZE[0], SIZE[1]);
        // -terminate: it ends with its last client, so that not even a killed test leaves one behind.
        let server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", &screen, "-nolisten", "tcp", "-terminate"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|e| panic!("Xvfb cannot be started ({e}); ./test installs it (package xvfb)"));
        let mut server = Server(server);
        // It says its number once it takes clients.
        let mut number = String::new();
        BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb ended at once; try it by hand: Xvfb -displayfd 1");
        let name = format!(":{}", number.trim());

        let (connection, screen) = RustConnection::connect(Some(&name)).unwrap();
        let setup = connection.setup();
        let root = setup.roots[screen].root;
        let first_key = setup.min_keycode;
        let mapping = connection.get_keyboard_mapping(first_key, setup.max_keycode - first_key + 1).unwrap();
        let mapping = mapping.reply().unwrap();
        let keysyms_per_key = usize::from(mapping.keysyms_per_keycode);
        Self { name, connection, root, keysyms: mapping.keysyms, keysyms_per_key, first_key, server }
    }

    /// What DISPLAY must be.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the server still runs.
    pub fn is_alive(&mut self) -> bool {
        self.server.0.try_wait().unwrap().is_none()
    }

    /// What the display shows.
    pub fn screenshot(&self) -> Picture {
        let [width, height] = SIZE;
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.root, 0, 0, width, height, u32::MAX).unwrap();
        let data = image.reply().unwrap().data;
        assert_eq!(data.len(), 4 * usize::from(width) * usize::from(height), "depth 24 is four bytes a pixel");
        let rgb = data.as_chunks::<4>().0.iter().flat_map(|&[blue, green, red, _]| [red, green, blue]).collect();
        Picture::new(width.into(), height.into(), rgb)
    }

    /// The window that is shown and has a title.
    pub fn window(&self) -> Option<Window> {
        let children = self.connection.query_tree(self.root).unwrap().reply().unwrap().children;
        // A window may be gone between two questions.
        children.into_iter().find(|&window| self.is_shown(window).unwrap_or(false) && self.title(window).is_some())
    }

    fn is_shown(&self, window: Window) -> Option<bool> {
        let attributes = self.connection.get_window_attributes(window).ok()?.reply().ok()?;
        Some(attributes.map_state == MapState::VIEWABLE && !attributes.override_redirect)
    }

    /// A window's title.
    pub fn title(&self, window: Window) -> Option<String> {
        let (property, kind) = (self.atom("_NET_WM_NAME"), self.atom("UTF8_STRING"));
        let title = self.connection.get_property(false, window, property, kind, 0, 1024).ok()?.reply().ok()?;
        (!title.value.is_empty()).then(|| String::from_utf8_lossy(&title.value).into_owned())
    }

    /// Left, top, width and height of a window on the display.
    pub fn rectangle(&self, window: Window) -> [i32; 4] {
        let size = self.connection.get_geometry(window).unwrap().reply().unwrap();
        let corner = self.connection.translate_coordinates(window, self.root, 0, 0).unwrap().reply().unwrap();
        [corner.dst_x.into(), corner.dst_y.into(), size.width.into(), size.height.into()]
    }

    /// Gives a window the keys.
    pub fn focus(&self, window: Window) {
        self.connection.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).unwrap().check().unwrap();
    }

    /// What a window manager's cross sends.
    pub fn ask_to_close(&self, window: Window) {
        let data = [self.atom("WM_DELETE_WINDOW"), x11rb::CURRENT_TIME, 0, 0, 0];
        let message = ClientMessageEvent::new(32, window, self.atom("WM_PROTOCOLS"), data);
        self.connection.send_event(false, window, EventMask::NO_EVENT, message).unwrap().check().unwrap();
    }

    /// Moves the pointer.
    pub fn move_to(&self, [x, y]: Place) {
        self.fake(xproto::MOTION_NOTIFY_EVENT, 0, [x, y]);
    }

    /// Holds a button of the mouse.
    pub fn press(&self, button: Button) {
        self.fake(xproto::BUTTON_PRESS_EVENT, button as u8, [0, 0]);
    }

    /// Lets a button of the mouse go.
    pub fn release(&self, button: Button) {
        self.fake(xproto::BUTTON_RELEASE_EVENT, button as u8, [0, 0]);
    }

    /// A click somewhere.
    pub fn click(&self, at: Place) {
        self.move_to(at);
        self.press(Button::Left);
        self.release(Button::Left);
    }

    /// Turns the wheel by notches where the pointer is; up is positive.
    pub fn wheel(&self, notches: i32) {
        let button = if notches > 0 { Button::WheelUp } else { Button::WheelDown };
        for _ in 0..notches.abs() {
            self.press(button);
            self.release(button);
        }
    }

    /// Presses a key while others are held: `keys(&[key::CONTROL], 's'.into())`.
    pub fn keys(&self, held: &[u32], keysym: u32) {
        let (code, shifted) = self.key_code(keysym);
        assert!(!shifted, "name the key {keysym:#x} by what it writes without Shift, and hold key::SHIFT");
        let held: Vec<u8> = held.iter().map(|k| self.key_code(*k).0).collect();
        held.iter().for_each(|k| self.fake(xproto::KEY_PRESS_EVENT, *k, [0, 0]));
        self.fake(xproto::KEY_PRESS_EVENT, code, [0, 0]);
        self.fake(xproto::KEY_RELEASE_EVENT, code, [0, 0]);
        held.iter().rev().for_each(|k| self.fake(xproto::KEY_RELEASE_EVENT, *k, [0, 0]));
    }

    /// Types a text that the keyboard's layout (US English) has keys for.
    pub fn type_text(&self, text: &str) {
        for letter in text.chars() {
            // Latin 1 letters are their own keysyms.
            let (code, shifted) = self.key_code(u32::from(letter));
            let shift = self.key_code(key::SHIFT).0;
            let events = [
                shifted.then_some((xproto::KEY_PRESS_EVENT, shift)),
                Some((xproto::KEY_PRESS_EVENT, code)),
                Some((xproto::KEY_RELEASE_EVENT, code)),
                shifted.then_some((xproto::KEY_RELEASE_EVENT, shift)),
            ];
            events.into_iter().flatten().for_each(|(event, code)| self.fake(event, code, [0, 0]));
        }
    }

    /// The key that writes a keysym, and whether Shift must be held.
    fn key_code(&self, keysym: u32) -> (u8, bool) {
        let columns = [false, true].into_iter().find_map(|shifted| {
            let keys = self.keysyms.chunks(self.keysyms_per_key);
            let row = keys.map(|k| k.get(usize::from(shifted))).position(|k| k == Some(&keysym))?;
            Some((self.first_key + row as u8, shifted))
        });
        columns.unwrap_or_else(|| panic!("the keyboard of {} has no key for {keysym:#x}", self.name))
    }

    /// One event, as from the device; the server has taken it when this returns.
    fn fake(&self, event: u8, detail: u8, [x, y]: Place) {
        self.connection.xtest_fake_input(event, detail, x11rb::CURRENT_TIME, self.root, x, y, 0).unwrap();
        self.connection.sync().unwrap();
    }

    fn atom(&self, name: &str) -> u32 {
        self.connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom
    }
}
