//! Which columns fit a terminal: the most telling ones stay longest.

use evac_frames::Health;

use crate::health_board::{age_s, state_word};
use crate::status::{instance_name, leads_from, memory, triple};
use crate::view::{InstanceView, StageView};

/// One column of the table.
pub(crate) struct Column {
    pub(crate) title: &'static str,
    pub(crate) width: u16,
    /// The higher, the sooner it is left out.
    rank: u8,
    pub(crate) cell: fn(&StageView, &InstanceView) -> String,
}

/// From left to right.
const COLUMNS: [Column; 15] = [
    Column { title: "stage", width: 16, rank: 0, cell: |stage, it| instance_name(&stage.name, &it.health) },
    Column { title: "state", width: 9, rank: 1, cell: |_, it| state_word(&it.health).to_owned() },
    Column {
        title: "Hz",
        width: 6,
        rank: 2,
        cell: |_, it| format!("{:.1}", it.health.rate_millihertz as f64 * 1e-3),
    },
    Column { title: "age s", width: 6, rank: 4, cell: |_, it| age(&it.health) },
    Column { title: "frames", width: 8, rank: 12, cell: |_, it| it.health.frames_out.to_string() },
    Column { title: "lost", width: 5, rank: 3, cell: |_, it| it.health.lost.to_string() },
    Column { title: "late", width: 5, rank: 10, cell: |_, it| it.health.late.to_string() },
    Column { title: "degr.", width: 6, rank: 13, cell: |_, it| it.health.degraded.to_string() },
    Column { title: "ipc ms", width: 18, rank: 8, cell: |_, it| triple(&it.health.ipc) },
    Column { title: "compute ms", width: 18, rank: 9, cell: |_, it| triple(&it.health.compute) },
    Column { title: "end to end ms", width: 18, rank: 5, cell: |_, it| triple(&it.health.end_to_end) },
    Column { title: "cpu %", width: 6, rank: 6, cell: |_, it| cpu(it) },
    Column { title: "MiB", width: 8, rank: 7, cell: |_, it| memory(it) },
    Column { title: "restarts", width: 8, rank: 11, cell: |stage, _| restarts(stage) },
    Column { title: "leads", width: 6, rank: 14, cell: leads },
];

/// The columns that fit.
pub(crate) fn fitting(width: u16) -> Vec<&'static Column> {
    let mut by_rank: Vec<_> = COLUMNS.iter().collect();
    by_rank.sort_by_key(|column| column.rank);
    let (mut used, mut last_rank) = (0, 0);
    for column in by_rank {
        used += column.width + 1;
        if used > width + 1 {
            break;
        }
        last_rank = column.rank;
    }
    COLUMNS.iter().filter(|column| column.rank <= last_rank).collect()
}

fn age(health: &Health) -> String {
    age_s(health).map_or("-".to_owned(), |age| format!("{age:.1}"))
}

fn cpu(instance: &InstanceView) -> String {
    instance.usage.map_or("-".to_owned(), |usage| format!("{:.1}", usage.cpu_percent))
}

fn restarts(stage: &StageView) -> String {
    stage.word.as_ref().map_or("-".to_owned(), |word| word.restarts.to_string())
}

fn leads(stage: &StageView, instance: &InstanceView) -> String {
    let first = stage.instances.first().map(|leader| leader.health.epoch);
    if first == Some(instance.health.epoch) { leads_from(stage) } else { "no".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_terminal_keeps_name_state_rate_and_losses_and_a_wide_one_has_everything() {
        let titles = |width| fitting(width).iter().map(|column| column.title).collect::<Vec<_>>();
        assert_eq!(titles(40), ["stage", "state", "Hz", "lost"]);
        assert!(titles(80).contains(&"end to end ms"));
        assert_eq!(titles(200).len(), COLUMNS.len());
        // Never nothing.
        assert_eq!(titles(5), ["stage"]);
        for width in 20..200 {
            let used: u16 = fitting(width).iter().map(|column| column.width + 1).sum();
            assert!(used <= width + 1, "{used} of {width}");
        }
    }
}
