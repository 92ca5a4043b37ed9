//! How far a long work is.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar on a terminal, a line now and then elsewhere.
pub(crate) struct Bar {
    bar: ProgressBar,
    about: String,
    last_line: std::cell::Cell<(u64, Instant)>,
}

/// Time between two lines where there is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

impl Bar {
    pub(crate) fn new(about: &str) -> Self {
        let bar = styled(None, "{msg} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left");
        bar.set_message(about.to_owned());
        Self { bar, about: about.to_owned(), last_line: std::cell::Cell::new((0, Instant::now())) }
    }

    pub(crate) fn show(&self, frames: u64, total: Option<u64>) {
        if let Some(total) = total {
            self.bar.set_length(total);
        }
        self.bar.set_position(frames);
        let (shown, when) = self.last_line.get();
        if self.bar.is_hidden() && frames > shown && when.elapsed() > LINE_INTERVAL {
            let of = total.map_or(String::new(), |total| format!(" of {total}"));
            tracing::info!("{}: {frames}{of} frames", self.about);
            self.last_line.set((frames, Instant::now()));
        }
    }

    pub(crate) fn end(&self) {
        self.bar.finish_and_clear();
    }
}

/// A bar on a terminal, nothing elsewhere, over `count` of what `unit` names.
pub(crate) fn bar(count: u64, unit: &str) -> ProgressBar {
    styled(Some(count), &format!("[{{bar:40}}] {{pos}}/{{len}} {unit}, {{eta}} left"))
}

/// Lines that are written again in place on a terminal (set as the message); hidden elsewhere.
pub(crate) fn text() -> ProgressBar {
    styled(None, "{msg}")
}

fn styled(count: Option<u64>, template: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(count, ProgressDrawTarget::stderr_with_hz(10));
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}
