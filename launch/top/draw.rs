//! The picture on the terminal.

use evac_frames::Health;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Paragraph, Row, Table};

use crate::health_board::{odometry_line, state_word};
use crate::status::triple;
use crate::top::columns::{Column, fitting};
use crate::view::{InstanceView, StageView, View};

/// What is shown.
#[derive(Debug)]
pub(crate) struct Screen {
    pub(crate) view: View,
    pub(crate) colour: bool,
    /// Rows that are scrolled out above.
    pub(crate) offset: usize,
}

/// Draws everything.
pub(crate) fn draw(frame: &mut Frame<'_>, screen: &mut Screen) {
    let rows: Vec<_> = rows(&screen.view).collect();
    let notes = notes(&screen.view);
    let table_height = u16::try_from(rows.len() + 1).unwrap_or(u16::MAX);
    let [title, table, below, keys] = Layout::vertical([
        Constraint::Length(2),
        Constraint::Max(table_height),
        Constraint::Min(0),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    frame.render_widget(Paragraph::new(heading(&screen.view)), title);
    let shown = usize::from(table.height.saturating_sub(1));
    screen.offset = screen.offset.min(rows.len().saturating_sub(shown));
    draw_table(frame, table, &rows[screen.offset..], screen.colour);
    frame.render_widget(Paragraph::new(notes), below);
    let hidden = rows.len().saturating_sub(shown);
    let scroll = if hidden > 0 { format!("  up, down scroll ({hidden} more rows)") } else { String::new() };
    frame.render_widget(Paragraph::new(format!("q quits{scroll}")), keys);
}

fn heading(view: &View) -> Vec<Line<'static>> {
    let [pose, plan] =
        view.sensor_to().map(|latency| latency.map_or("-".to_owned(), |latency| triple(&latency)));
    vec![
        Line::styled(
            format!("evac  domain {}  launcher {}", view.domain, view.launcher),
            Style::new().add_modifier(Modifier::BOLD),
        ),
        Line::raw(format!("ms p50/p99/max: sensor to pose {pose}, to plan {plan}")),
    ]
}

fn rows(view: &View) -> impl Iterator<Item = (&StageView, &InstanceView)> {
    view.stages.iter().flat_map(|stage| stage.instances.iter().map(move |instance| (stage, instance)))
}

fn draw_table(frame: &mut Frame<'_>, area: Rect, rows: &[(&StageView, &InstanceView)], colour: bool) {
    let columns = fitting(area.width);
    let widths = columns.iter().map(|column| Constraint::Length(column.width));
    let table = rows.iter().map(|(stage, instance)| {
        Row::new(
            columns
                .iter()
                .enumerate()
                .map(|(place, column)| aligned(place, column, (column.cell)(stage, instance))),
        )
        .style(style(instance, colour))
    });
    let header = Row::new(
        columns.iter().enumerate().map(|(place, column)| aligned(place, column, column.title.to_owned())),
    )
    .style(Style::new().add_modifier(Modifier::REVERSED));
    frame.render_widget(Table::new(table, widths).header(header), area);
}

/// Words to the left, numbers to the right.
fn aligned(place: usize, column: &Column, text: String) -> String {
    if place < 2 { text } else { format!("{text:>width$}", width = usize::from(column.width)) }
}

/// Without colour what is wrong is bold.
fn style(instance: &InstanceView, colour: bool) -> Style {
    let (health, bold) = (&instance.health, Style::new().add_modifier(Modifier::BOLD));
    match state_word(health) {
        "failed" if colour => bold.fg(Color::Red),
        "failed" => bold,
        _ if health.lost + health.late > 0 => {
            if colour {
                Style::new().fg(Color::Yellow)
            } else {
                bold
            }
        }
        "running" if colour => Style::new().fg(Color::Green),
        _ => Style::new(),
    }
}

/// What there is to say about stages in words.
fn notes(view: &View) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    for (stage, instance) in rows(view) {
        let reason = Health::text_of(&instance.health.reason);
        let own = (!reason.is_empty()).then_some(reason);
        for text in odometry_line(&instance.health).into_iter().chain(own) {
            lines.push(Line::raw(format!("{}: {text}", stage.name)));
        }
    }
    lines
}
