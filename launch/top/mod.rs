//! `evac top`: what `evac status` says, live on a terminal.

mod columns;
mod draw;

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::DefaultTerminal;

use crate::cli::DomainArgs;
use crate::error::LaunchError;
use crate::status::domain_of;
use crate::top::draw::{Screen, draw};
use crate::view::Watcher;

/// Time between two looks at the pipeline.
const REFRESH: Duration = Duration::from_secs(1);
/// Time within which SIGTERM is heeded.
const LOOK_AGAIN: Duration = Duration::from_millis(200);

/// `evac top [PIPELINE.toml]`.
pub(crate) fn top(args: &DomainArgs) -> Result<(), LaunchError> {
    let domain = domain_of(args)?;
    let (mut watcher, _listener) = Watcher::open(&domain, "top")?;
    if !std::io::stdout().is_terminal() || !std::io::stdin().is_terminal() {
        return Err(LaunchError::Path(
            "evac top needs a terminal; `evac status --json` is for programs".to_owned(),
        ));
    }
    // From here on a panic restores the terminal before it says anything.
    let mut terminal = ratatui::try_init().map_err(|cause| broken(&cause))?;
    let result = show(&mut terminal, &mut watcher);
    let restored = ratatui::try_restore().map_err(|cause| broken(&cause));
    if result? == End::Pipeline {
        println!("the pipeline in domain '{}' has ended", domain.name());
    }
    restored
}

/// Why the display ended.
#[derive(Debug, PartialEq, Eq)]
enum End {
    /// A key or a signal.
    Asked,
    /// Nothing is left to show.
    Pipeline,
}

fn show(terminal: &mut DefaultTerminal, watcher: &mut Watcher) -> Result<End, LaunchError> {
    let colour = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let mut screen = Screen { view: watcher.look()?, colour, offset: 0 };
    let mut looked = Instant::now();
    loop {
        terminal.draw(|frame| draw(frame, &mut screen)).map_err(|cause| broken(&cause))?;
        let until = Instant::now() + REFRESH.saturating_sub(looked.elapsed());
        loop {
            if watcher.bus.stop_requested() {
                return Ok(End::Asked);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            if !event::poll(left.min(LOOK_AGAIN)).map_err(|cause| broken(&cause))? {
                continue;
            }
            match event::read().map_err(|cause| broken(&cause))? {
                Event::Key(key) if key.kind != KeyEventKind::Release => match key {
                    KeyEvent { code: KeyCode::Char('q') | KeyCode::Esc, .. } => return Ok(End::Asked),
                    KeyEvent { code: KeyCode::Char('c'), modifiers: KeyModifiers::CONTROL, .. } => {
                        return Ok(End::Asked);
                    }
                    KeyEvent { code: KeyCode::Down | KeyCode::Char('j'), .. } => screen.offset += 1,
                    KeyEvent { code: KeyCode::Up | KeyCode::Char('k'), .. } => {
                        screen.offset = screen.offset.saturating_sub(1);
                    }
                    _ => continue,
                },
                // Drawn anew in its new size.
                Event::Resize(..) => {}
                _ => continue,
            }
            break;
        }
        if looked.elapsed() >= REFRESH {
            match watcher.look() {
                Ok(view) => screen.view = view,
                Err(_) => return Ok(End::Pipeline),
            }
            looked = Instant::now();
        }
    }
}

fn broken(cause: &std::io::Error) -> LaunchError {
    LaunchError::Path(format!("the terminal: {cause}"))
}
