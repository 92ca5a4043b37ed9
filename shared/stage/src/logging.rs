//! Logs on standard error: lines for people, JSON on request.

use std::fmt::Display;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Args, ValueEnum};
use tracing_subscriber::filter::LevelFilter;

/// Flags of every command that logs.
#[derive(Debug, Clone, Copy, Args)]
pub struct LogOptions {
    /// Least important level that is logged.
    #[arg(long, value_enum, default_value_t = Level::Info)]
    pub log_level: Level,
    /// Lines for people, or JSON lines.
    #[arg(long, value_enum, env = "EVAC_LOG_FORMAT", default_value_t = Format::Text)]
    pub log_format: Format,
}

/// Log levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Level {
    /// What makes a stage fail.
    Error,
    /// What an operator should look at.
    Warn,
    /// What an operator may want to know.
    Info,
    /// What a developer wants to know.
    Debug,
    /// Each frame.
    Trace,
}

/// How a log line is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    Text,
    /// One JSON object a line, for programs; everything on standard error is, errors at the end included.
    Json,
}

impl LogOptions {
    /// The same flags for a child process.
    pub fn as_args(&self) -> Vec<String> {
        let name = |value: Option<clap::builder::PossibleValue>| {
            value.map_or_else(String::new, |value| value.get_name().to_owned())
        };
        let mut args = vec!["--log-level".to_owned(), name(self.log_level.to_possible_value())];
        // Text is what a stage writes anyway: one that knows nothing of formats need not know the option.
        if self.log_format == Format::Json {
            args.extend(["--log-format".to_owned(), name(self.log_format.to_possible_value())]);
        }
        args
    }
}

/// Whether this process logs JSON.
static JSON: AtomicBool = AtomicBool::new(false);

/// Starts logging; a second call in one process changes nothing.
pub fn start_logging(options: &LogOptions) {
    let filter = match options.log_level {
        Level::Error => LevelFilter::ERROR,
        Level::Warn => LevelFilter::WARN,
        Level::Info => LevelFilter::INFO,
        Level::Debug => LevelFilter::DEBUG,
        Level::Trace => LevelFilter::TRACE,
    };
    evac_ports::quiet_middleware(options.log_level != Level::Trace);
    let builder = tracing_subscriber::fmt().with_max_level(filter).with_writer(std::io::stderr);
    // The only error is that a subscriber is set already, which is what a second call means.
    if options.log_format == Format::Json {
        if builder.json().try_init().is_ok() {
            JSON.store(true, Ordering::Relaxed);
            std::panic::set_hook(Box::new(|panic| tracing::error!("{panic}")));
        }
    } else {
        let is_terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
        let _ = builder.with_target(false).with_ansi(is_terminal).try_init();
    }
}

/// Says on standard error why a process ends: for people, or as the log does where that is JSON.
pub fn say_failure(name: &str, cause: &dyn Display) {
    if JSON.load(Ordering::Relaxed) {
        tracing::error!(name, "{cause}");
    } else {
        eprintln!("{name}: {cause}");
    }
}
