//! Logs on standard error: lines for people, JSON on request.

use clap::{Args, ValueEnum};
use tracing_subscriber::filter::LevelFilter;

/// Flags of every command that logs.
#[derive(Debug, Clone, Copy, Args)]
pub struct LogOptions {
    /// Least important level that is logged.
    #[arg(long, value_enum, default_value_t = Level::Info)]
    pub log_level: Level,
    /// Log JSON lines instead of text.
    #[arg(long)]
    pub log_json: bool,
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

impl LogOptions {
    /// The same flags for a child process.
    pub fn as_args(&self) -> Vec<String> {
        let level = self.log_level.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned());
        let mut args = vec!["--log-level".to_owned(), level];
        if self.log_json {
            args.push("--log-json".to_owned());
        }
        args
    }
}

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
    let _ = if options.log_json {
        builder.json().try_init().is_ok()
    } else {
        builder
            .with_target(false)
            .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
            .try_init()
            .is_ok()
    };
}
