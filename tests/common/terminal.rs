//! A command on a real pseudo-terminal, and what it shows there.
#![allow(dead_code)] // not every test needs all of it

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::num::NonZeroU16;
use std::os::fd::OwnedFd;
use std::process::{Child, Command};
use std::sync::{Arc, Mutex};

use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use crate::common::wait_for;

/// A terminal with a command on it; killed when dropped.
pub(crate) struct Terminal {
    child: Child,
    master: File,
    /// Kept open, so that the terminal's state can be looked at when the command has ended.
    line: OwnedFd,
    seen: Arc<Mutex<Seen>>,
}

struct Seen {
    parser: vt100::Parser,
    /// A colour was asked for at any time.
    colours: bool,
}

impl Terminal {
    /// Starts a command on a new terminal of so many rows and columns.
    pub(crate) fn start(command: Command, (rows, columns): (u16, u16)) -> Self {
        let mut command = in_session(&command);
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let line = File::options().read(true).write(true).open(name.to_str().unwrap()).unwrap();
        tcsetwinsize(&line, size((rows, columns))).unwrap();
        for stream in [Command::stdin, Command::stdout, Command::stderr] {
            stream(&mut command, line.try_clone().unwrap());
        }
        let child = command.env("TERM", "xterm-256color").spawn().unwrap();
        let master = File::from(master);
        let seen = Seen { parser: vt100::Parser::new(not_zero(rows), not_zero(columns), 0), colours: false };
        let seen = Arc::new(Mutex::new(seen));
        let (mut reader, shared) = (master.try_clone().unwrap(), seen.clone());
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = reader.read(&mut bytes) {
                let mut seen = shared.lock().unwrap();
                seen.parser.process(&bytes[..count]);
                seen.colours |= has_colours(seen.parser.screen());
            }
        });
        Self { child, master, line: line.into(), seen }
    }

    /// Waits until the screen is as it should be; gives its text.
    #[track_caller]
    pub(crate) fn wait_for(&mut self, what: &str, is_it: impl Fn(&str) -> bool) -> String {
        wait_for(what, || {
            let text = self.seen.lock().unwrap().parser.screen().contents();
            is_it(&text).then_some(text)
        })
    }

    pub(crate) fn is_alternate(&self) -> bool {
        self.seen.lock().unwrap().parser.screen().alternate_screen()
    }

    /// Whether keys reach the command at once and are not shown.
    pub(crate) fn is_raw(&self) -> bool {
        !tcgetattr(&self.line).unwrap().local_modes.intersects(LocalModes::ECHO | LocalModes::ICANON)
    }

    /// Whether anything was coloured so far.
    pub(crate) fn has_colours(&self) -> bool {
        self.seen.lock().unwrap().colours
    }

    pub(crate) fn resize(&mut self, to: (u16, u16)) {
        tcsetwinsize(&self.line, size(to)).unwrap();
        self.seen.lock().unwrap().parser.screen_mut().set_size(not_zero(to.0), not_zero(to.1));
    }

    pub(crate) fn type_keys(&mut self, keys: &str) {
        self.master.write_all(keys.as_bytes()).unwrap();
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for the command's end and looks at what it leaves: the terminal as it was. Gives the exit code.
    #[track_caller]
    pub(crate) fn end(mut self) -> i32 {
        let status = wait_for("the command to end", || self.child.try_wait().unwrap());
        wait_for("the last bytes", || (!self.is_alternate()).then_some(()));
        assert!(!self.is_raw(), "the terminal is left raw");
        assert!(!self.seen.lock().unwrap().parser.screen().hide_cursor(), "the cursor is left hidden");
        status.code().unwrap_or(-1)
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The same in a session of its own whose controlling terminal is the new one: as after a login.
fn in_session(command: &Command) -> Command {
    let mut session = Command::new("setsid");
    session.arg("--ctty").arg(command.get_program()).args(command.get_args());
    session.envs(command.get_envs().filter_map(|(key, value)| Some((key, value?))));
    if let Some(folder) = command.get_current_dir() {
        session.current_dir(folder);
    }
    session
}

fn not_zero(number: u16) -> NonZeroU16 {
    NonZeroU16::new(number).unwrap()
}

fn size((ws_row, ws_col): (u16, u16)) -> Winsize {
    Winsize { ws_row, ws_col, ws_xpixel: 0, ws_ypixel: 0 }
}

fn has_colours(screen: &vt100::Screen) -> bool {
    let (rows, columns) = screen.size();
    let (rows, columns) = (rows.get(), columns.get());
    let mut cells = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
    cells.any(|(row, column)| {
        screen.cell(row, column).is_some_and(|cell| cell.fgcolor() != vt100::Color::Default)
    })
}
