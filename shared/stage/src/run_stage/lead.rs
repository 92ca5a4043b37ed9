//! Frames of an instance that leads, and what it writes down of them.

use evac_frames::{FrameHeader, StageState, frame_flags};
use evac_ports::now_ns;

use super::Running;
use crate::joins::Join;
use crate::journal::{self, Head, Journal, Start};
use crate::{RunError, Stage, StageError, StageOutput as _};

impl<S, J> Running<S, J>
where
    J: Join,
    S: for<'a> Stage<Input<'a> = J::Frame<'a>>,
{
    /// Processes one complete set, if there is one. A processor whose stream has ended stays until it is told to stop, so
    /// that nothing it has published is taken away before it is read; a sink finishes its files and ends.
    pub(super) fn process_next(&mut self) -> Result<bool, RunError> {
        let (stage, output, leads_from) = (&mut self.stage, &mut self.output, self.leads_from);
        let read_back = &mut self.read_back;
        let complete_ns = now_ns();
        let handled = self.join.next(&mut self.reporter, |input, frame, reporter| {
            if frame.seq < leads_from {
                stage.follow(input, None)?;
                return Ok(*frame);
            }
            // Readers go on with what was read back only if nothing is missing after it.
            if std::mem::take(read_back) && frame.seq > leads_from {
                output.go_on_with(None);
            }
            reporter.begin();
            stage.process(input, output, &mut reporter.counters)?;
            reporter.odometry = output.odometry();
            if !stage.note().is_empty() {
                reporter.note(stage.note());
            }
            reporter.done(frame, complete_ns);
            Ok::<FrameHeader, StageError>(*frame)
        });
        let Some(frame) = handled.transpose()? else { return Ok(false) };
        if frame.seq < leads_from {
            return Ok(true);
        }
        self.write_down(&frame);
        let Some(frame) = self.join.done(&frame) else { return Ok(true) };
        let awaited = self.last_seq.map_or(frame.seq, |last| last.saturating_add(1));
        if frame.seq > awaited {
            self.reporter.missed(awaited, frame.seq - 1);
        }
        self.last_seq = Some(frame.seq);
        self.ended = frame.flags & frame_flags::END_OF_STREAM != 0;
        if self.ended {
            self.end()?;
        }
        if let Some(ack) = &self.ack {
            ack.send(frame.seq, self.ended)?;
        }
        Ok(true)
    }

    fn write_down(&mut self, frame: &FrameHeader) {
        let Some(journal) = &mut self.journal else { return };
        let head = Head { seq: frame.seq, lineage: self.output.lineage() };
        let goes_on = journal.write(head, |entry, whole| self.stage.write_down(entry, whole));
        self.reporter.journal_dropped = journal.dropped();
        if !goes_on {
            self.journal = None;
            self.reporter.note("the journal has ended, see the log");
        }
    }

    pub(super) fn open_journal(&mut self, start: Start) -> Result<(), RunError> {
        self.journal = self.place.as_ref().map(|place| Journal::open(place, start)).transpose()?;
        Ok(())
    }

    /// Goes on where an instance was that has been killed, as far as it had written it down.
    pub(super) fn read_back(&mut self) -> Result<(), RunError> {
        let Some(place) = &self.place else {
            self.join.resume(None);
            return Ok(());
        };
        let stage = &mut self.stage;
        let read = journal::read_back(&place.folder, |entry| stage.read_back(entry))?;
        self.join.resume(read.map(|read| read.head.seq));
        let Some(read) = read else { return self.open_journal(Start::Empty) };
        tracing::info!(frame = read.head.seq, "goes on from the journal");
        self.output.go_on_with(Some(read.head.lineage));
        (self.last_seq, self.read_back) = (Some(read.head.seq), true);
        self.open_journal(Start::After(read))
    }

    pub(super) fn end(&mut self) -> Result<(), RunError> {
        self.stage.finish()?;
        let state = if self.role.leads() { StageState::Finished } else { StageState::Shadow };
        Ok(self.reporter.end(state, "")?)
    }
}
