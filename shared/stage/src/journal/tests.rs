use super::*;

fn voxel(x: u16, flags: u16, log_odds: f32) -> Voxel {
    Voxel { key: [x, 1, 2], flags, log_odds }
}

/// What a stage would be made of by reading the journal.
#[derive(Debug, Default, PartialEq)]
struct Content {
    now: Vec<u8>,
    added: Vec<u8>,
    voxels: std::collections::BTreeMap<[u16; 3], (u16, u32)>,
}

impl Content {
    fn take(&mut self, entry: &Entry) {
        if !entry.now.bytes().is_empty() {
            self.now = entry.now.bytes().to_vec();
        }
        self.added.extend_from_slice(entry.added.bytes());
        for voxel in &entry.voxels {
            self.voxels.insert(voxel.key, (voxel.flags, voxel.log_odds.to_bits()));
        }
        self.voxels.retain(|_, (flags, _)| *flags != 0);
    }

    fn read(folder: &Path) -> (Self, Option<ReadBack>) {
        let mut content = Self::default();
        let read = read_back(folder, |entry| {
            content.take(entry);
            Ok(())
        });
        (content, read.unwrap())
    }
}

fn place(folder: &Path) -> Place {
    Place { folder: folder.to_owned(), lossless: true, max_bytes: 1 << 30 }
}

/// Frame `seq` of a stage that changes some voxels, forgets others, and adds a number.
fn fill(seq: u64, entry: &mut Entry) {
    entry.now.put(seq);
    entry.added.put(seq * 7);
    entry.voxels.extend((0..40).map(|i| voxel((seq * 13 + i * 5) as u16 % 500, 2, (seq + i) as f32)));
    entry.voxels.push(voxel(seq as u16 * 3 % 500, 0, 0.0));
}

fn write(journal: &mut Journal, seqs: std::ops::Range<u64>, content: &mut Content) {
    for seq in seqs {
        assert!(journal.write(Head { seq, lineage: 3 }, |entry, whole| {
            assert!(!whole);
            fill(seq, entry);
            content.take(entry);
        }));
    }
}

#[test]
fn what_was_written_is_read_back_and_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (mut content, mut read) = (Content::default(), None);
    for part in 0..4 {
        let start = read.map_or(Start::Empty, Start::After);
        let mut journal = Journal::open(&place(folder.path()), start).unwrap();
        write(&mut journal, part * 10..part * 10 + 10, &mut content);
        drop(journal);
        let (found, back) = Content::read(folder.path());
        assert_eq!(found, content);
        assert_eq!(back.unwrap().head, Head { seq: part * 10 + 9, lineage: 3 });
        read = back;
    }
}

#[test]
fn an_entry_that_was_torn_off_ends_the_journal_before_it_whatever_its_bytes_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(&place(folder.path()), Start::Empty).unwrap();
    let mut content = Content::default();
    write(&mut journal, 0..5, &mut content);
    drop(journal);
    let log = folder.path().join("log-0");
    let whole = std::fs::read(&log).unwrap();
    for cut in [whole.len() - 1, whole.len() - 100, 41, 17, 0] {
        std::fs::write(&log, &whole[..cut]).unwrap();
        let (_, back) = Content::read(folder.path());
        assert!(back.is_none_or(|back| back.head.seq < 4), "{cut}");
    }
    for at in (0..whole.len()).step_by(7) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x41;
        std::fs::write(&log, &damaged).unwrap();
        let (_, back) = Content::read(folder.path());
        assert!(back.is_none_or(|back| back.head.seq < 4), "{at}");
    }
}

#[test]
fn a_base_and_its_log_become_one_base_with_the_same_content() {
    let folder = tempfile::tempdir().unwrap();
    let mut content = Content::default();
    let mut log = Log::create_first(folder.path()).unwrap();
    for seq in 0..60 {
        let mut entry = Entry::default();
        fill(seq, &mut entry);
        content.take(&entry);
        log.write(Head { seq, lineage: 1 }, &entry).unwrap();
        if seq % 17 == 16 {
            let (base, old) = (log.base(), log.log());
            log.rotate(|writer| merge::merge(&base, &old, writer)).unwrap();
        }
        let (found, back) = Content::read(folder.path());
        assert_eq!(found, content, "{seq}");
        assert_eq!(back.unwrap().head.seq, seq);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn who_takes_over_replaces_what_another_wrote_only_when_everything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut first = Journal::open(&place(folder.path()), Start::Empty).unwrap();
    let mut content = Content::default();
    write(&mut first, 0..5, &mut content);
    drop(first);
    let mut second = Journal::open(&place(folder.path()), Start::Whole).unwrap();
    assert_eq!(Content::read(folder.path()).0, content);
    assert!(second.write(Head { seq: 9, lineage: 3 }, |entry, whole| {
        assert!(whole);
        fill(77, entry);
    }));
    drop(second);
    let (found, back) = Content::read(folder.path());
    assert_eq!((found.now, back.unwrap().head.seq), (77_u64.to_le_bytes().to_vec(), 9));
}

#[test]
fn what_held_everything_once_does_not_keep_its_size() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(&place(folder.path()), Start::Whole).unwrap();
    let all = 100_000;
    for seq in 0..3 * LOSSLESS_SLIPS as u64 {
        let written = journal.write(Head { seq, lineage: 3 }, |entry, whole| {
            assert_eq!(whole, seq == 0);
            assert!(entry.voxels.capacity() < all, "{seq}: {}", entry.voxels.capacity());
            entry.voxels.extend((0..if whole { all } else { 10 }).map(|i| voxel(i as u16, 2, 0.5)));
        });
        assert!(written);
    }
}

#[test]
fn without_a_journal_nothing_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(Content::read(folder.path()).1, None);
    assert_eq!(Content::read(&folder.path().join("nowhere")).1, None);
}
