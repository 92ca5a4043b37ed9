//! A harness for the `evac` command: real processes, a domain and a folder of its own for each test, a watchdog on each.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub)]

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use evac_ports::Domain;
use tempfile::TempDir;

/// A test that hangs is ended after this; nothing is asserted about how fast anything is.
pub const WATCHDOG: Duration = Duration::from_secs(400);

/// A folder and a domain.
pub struct Bench {
    folder: TempDir,
    pub domain: Domain,
}

impl Bench {
    pub fn new() -> Self {
        static COUNTER: AtomicU32 = AtomicU32::new(0);
        let number = COUNTER.fetch_add(1, Ordering::Relaxed);
        let domain = Domain::new(&format!("test-{}-{number}", std::process::id())).unwrap();
        Self { folder: tempfile::tempdir().unwrap(), domain }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|cause| panic!("{name}: {cause}"))
    }

    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|cause| panic!("{name}: {cause}"))
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    /// `evac ARGS` in the folder.
    pub fn evac<S: AsRef<std::ffi::OsStr>>(&self, args: impl IntoIterator<Item = S>) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_evac"));
        command.args(args).current_dir(self.folder.path());
        command
    }

    /// Runs to the end and gives code, standard output and standard error.
    pub fn run<S: AsRef<std::ffi::OsStr>>(&self, args: impl IntoIterator<Item = S>) -> Ended {
        Running::start(self.evac(args)).end()
    }

    /// What the domain has left in shared memory and its folder.
    pub fn leftovers(&self) -> Vec<String> {
        let prefix = self.domain.prefix();
        let in_memory = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().file_name());
        let mut left: Vec<_> = in_memory
            .map(|name| name.into_string().unwrap())
            .filter(|name| name.starts_with(&prefix))
            .collect();
        if self.domain.folder().exists() {
            left.push(self.domain.folder().display().to_string());
        }
        left
    }
}

/// How a command ended.
pub struct Ended {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Ended {
    #[track_caller]
    pub fn expect_success(self) -> Self {
        assert_eq!(self.code, 0, "stdout:\n{}\nstderr:\n{}", self.stdout, self.stderr);
        self
    }

    /// Ended with `code` and one message that holds all `words`.
    #[track_caller]
    pub fn expect_error(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, code, "stderr:\n{}", self.stderr);
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        let errors: Vec<_> =
            self.stderr.lines().filter(|line| !line.contains(" INFO ") && line.contains(": ")).collect();
        assert_eq!(errors.len(), 1, "one error, not:\n{}", self.stderr);
        for word in words {
            assert!(self.stderr.contains(word), "no '{word}' in:\n{}", self.stderr);
        }
    }
}

/// A command that runs; killed when dropped.
pub struct Running {
    child: Option<Child>,
    readers: Vec<std::thread::JoinHandle<String>>,
}

impl Running {
    pub fn start(mut command: Command) -> Self {
        command.stdin(Stdio::null());
        Self::spawn(command)
    }

    /// With what is to be written to its standard input.
    pub fn start_with_input(mut command: Command) -> (Self, ChildStdin) {
        command.stdin(Stdio::piped());
        let mut running = Self::spawn(command);
        let input = running.child.as_mut().unwrap().stdin.take().unwrap();
        (running, input)
    }

    fn spawn(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("evac starts");
        let mut readers = Vec::new();
        let streams: [Box<dyn std::io::Read + Send>; 2] =
            [Box::new(child.stdout.take().unwrap()), Box::new(child.stderr.take().unwrap())];
        for mut stream in streams {
            readers.push(std::thread::spawn(move || {
                let mut text = String::new();
                stream.read_to_string(&mut text).map(|_| text).unwrap_or_default()
            }));
        }
        Self { child: Some(child), readers }
    }

    pub fn pid(&self) -> i32 {
        i32::try_from(self.child.as_ref().unwrap().id()).unwrap()
    }

    pub fn signal(&self, signal: rustix::process::Signal) {
        rustix::process::kill_process(rustix::process::Pid::from_raw(self.pid()).unwrap(), signal).unwrap();
    }

    pub fn is_running(&mut self) -> bool {
        self.child.as_mut().unwrap().try_wait().unwrap().is_none()
    }

    /// Waits for the end.
    #[track_caller]
    pub fn end(mut self) -> Ended {
        let started = Instant::now();
        while self.is_running() {
            assert!(started.elapsed() < WATCHDOG, "the watchdog ended a command that hung");
            std::thread::sleep(Duration::from_millis(10));
        }
        let status = self.child.take().unwrap().wait().unwrap();
        let mut texts = std::mem::take(&mut self.readers).into_iter().map(|reader| reader.join().unwrap());
        let (stdout, stderr) = (texts.next().unwrap(), texts.next().unwrap());
        Ended { code: status.code().unwrap_or(-1), stdout, stderr }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Repeats `look` until it gives something; the watchdog ends a test that never gets there.
#[track_caller]
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let started = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(started.elapsed() < WATCHDOG, "the watchdog ended the wait for {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Runs another program; `None` with a printed line where it is not installed.
pub fn other_program(name: &str, args: &[&Path]) -> Option<Output> {
    match Command::new(name).args(args).output() {
        Ok(output) => Some(output),
        Err(cause) => {
            println!("skipped: {name}: {cause}");
            None
        }
    }
}
