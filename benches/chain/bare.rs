//! The same hops by iceoryx2 alone: processes that take a frame, work as long as a stage does, write the next one and pass it on.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use evac_ports::{Domain, now_ns};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use rustix::process::{Signal, set_parent_process_death_signal};

type Ipc = ipc::Service;

/// First argument of a link.
const LINK: &str = "--chain-link";
const READY: &str = "ready";
/// Bytes that each hop carries: a scan of 10,000 points, the same deskewed, a pose, an update of 2000 voxels.
const BYTES: [usize; 4] = [160_000, 160_000, 328, 24_000];
/// Hops, one less than processes.
pub(crate) const HOPS: usize = BYTES.len();
/// Readers of each hop besides the next link, as the stages' services have them: the launcher, and stages that need the frame later. They are
/// not woken.
const OTHERS: [usize; HOPS] = [1, 3, 5, 1];
/// What each link works between two hops, about as long as the stages do (benches/README.md): source, deskewer, lio, mapper.
const WORK: [Duration; HOPS] =
    [Duration::ZERO, Duration::from_micros(100), Duration::from_micros(2300), Duration::ZERO];
pub(crate) const PERIOD: Duration = Duration::from_millis(100);
const PATIENCE: Duration = Duration::from_secs(30);
/// Words at a frame's start: its number, when it was sent, and what each hop before has taken.
const HEAD: usize = 2 + HOPS;

/// The processes; dropping them ends them.
#[derive(Debug)]
pub(crate) struct Chain {
    links: Vec<Child>,
    last: Input,
    others: Vec<Subscriber<Ipc, [u64], ()>>,
    _node: Node<Ipc>,
}

impl Chain {
    /// Starts all links, the last one first, and one that is woken by the last hop's frames as well. Frames leave at `phase_ns` and a whole
    /// number of periods from it.
    ///
    /// # Errors
    /// A process did not start.
    pub(crate) fn start(domain: &Domain, phase_ns: i64) -> anyhow::Result<Self> {
        let node = node(domain)?;
        let last = Input::open(&node, HOPS - 1)?;
        let mut others = Vec::new();
        for (hop, count) in OTHERS.into_iter().enumerate() {
            for _ in 0..count {
                others.push(subscriber(&node, hop)?);
            }
        }
        let mut chain = Self { links: Vec::new(), last, others, _node: node };
        for link in (0..=HOPS).rev() {
            let mut child = Command::new(std::env::current_exe()?)
                .args([LINK, &link.to_string(), domain.name(), &phase_ns.to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .spawn()?;
            let stdout = child.stdout.take().context("a link has no output")?;
            chain.links.push(child);
            let mut line = String::new();
            BufReader::new(stdout).read_line(&mut line)?;
            anyhow::ensure!(line.trim() == READY, "a link did not get ready");
        }
        Ok(chain)
    }

    /// The next frame's hops, nanoseconds.
    ///
    /// # Errors
    /// None comes.
    pub(crate) fn next(&self) -> anyhow::Result<[i64; HOPS]> {
        let mut hops = [0; HOPS];
        self.last.take(&mut |head| {
            for (hop, word) in hops.iter_mut().zip(&head[2..]) {
                *hop = *word as i64;
            }
            Ok(())
        })?;
        for other in &self.others {
            while other.receive().map_err(failed)?.is_some() {}
        }
        Ok(hops)
    }
}

impl Drop for Chain {
    fn drop(&mut self) {
        for link in &mut self.links {
            // It may have ended by itself; either way it is reaped here.
            let _ = link.kill();
            let _ = link.wait();
        }
    }
}

/// Does a link's work if this process was started as one; false otherwise.
///
/// # Errors
/// The services cannot be used.
pub(crate) fn serve_if_link() -> anyhow::Result<bool> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [LINK, link, domain, phase_ns] = arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] else {
        return Ok(false);
    };
    set_parent_process_death_signal(Some(Signal::KILL))?;
    let (link, domain) = (link.parse::<usize>()?, Domain::new(domain)?);
    let node = node(&domain)?;
    let output = if link < HOPS { Some(Output::open(&node, link)?) } else { None };
    let input = if link > 0 { Some(Input::open(&node, link - 1)?) } else { None };
    let mut stdout = std::io::stdout();
    writeln!(stdout, "{READY}")?;
    stdout.flush()?;
    let period_ns = PERIOD.as_nanos() as i64;
    let mut next_ns = now_ns() - (now_ns() - phase_ns.parse::<i64>()?).rem_euclid(period_ns);
    for seq in 0.. {
        let mut head = [0; HEAD];
        match &input {
            Some(input) => input.take(&mut |words| {
                head.copy_from_slice(words);
                work(WORK.get(link).copied().unwrap_or_default());
                Ok(())
            })?,
            None => {
                next_ns += period_ns;
                std::thread::sleep(Duration::from_nanos((next_ns - now_ns()).max(0).unsigned_abs()));
                head[0] = seq;
            }
        }
        if let Some(output) = &output {
            output.send(&head)?;
        }
    }
    Ok(true)
}

fn work(how_long: Duration) {
    let until = now_ns() + how_long.as_nanos() as i64;
    while now_ns() < until {
        std::hint::spin_loop();
    }
}

fn failed(cause: impl std::fmt::Debug) -> anyhow::Error {
    anyhow!("iceoryx2: {cause:?}")
}

fn node(domain: &Domain) -> anyhow::Result<Node<Ipc>> {
    set_log_level(LogLevel::Error);
    let mut config = Config::default();
    config.global.prefix = FileName::new(domain.prefix().as_bytes()).map_err(failed)?;
    let root = Path::new(domain.folder().as_os_str().as_encoded_bytes()).map_err(failed)?;
    config.global.set_root_path(&root);
    NodeBuilder::new().config(&config).create::<Ipc>().map_err(failed)
}

fn subscriber(node: &Node<Ipc>, hop: usize) -> anyhow::Result<Subscriber<Ipc, [u64], ()>> {
    let name = ServiceName::new(&format!("chain/{hop}")).map_err(failed)?;
    let data = node.service_builder(&name).publish_subscribe::<[u64]>().open_or_create().map_err(failed)?;
    data.subscriber_builder().create().map_err(failed)
}

/// The end of a hop.
#[derive(Debug)]
struct Input {
    subscriber: Subscriber<Ipc, [u64], ()>,
    listener: Listener<Ipc>,
    hop: usize,
}

impl Input {
    fn open(node: &Node<Ipc>, hop: usize) -> anyhow::Result<Self> {
        let name = ServiceName::new(&format!("chain/{hop}")).map_err(failed)?;
        let events = node.service_builder(&name).event().open_or_create().map_err(failed)?;
        let listener = events.listener_builder().create().map_err(failed)?;
        Ok(Self { subscriber: subscriber(node, hop)?, listener, hop })
    }

    /// Sleeps until a frame comes; gives its head, with what this hop took written into it.
    fn take(&self, done: &mut dyn FnMut(&[u64]) -> anyhow::Result<()>) -> anyhow::Result<()> {
        let until = now_ns() + PATIENCE.as_nanos() as i64;
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(failed)? {
                let received_ns = now_ns();
                let mut head = [0; HEAD];
                head.copy_from_slice(sample.payload().get(..HEAD).context("a frame is too short")?);
                head[2 + self.hop] = (received_ns - head[1] as i64).unsigned_abs();
                return done(&head);
            }
            anyhow::ensure!(now_ns() < until, "no frame comes");
            self.listener.timed_wait(|_| {}, Duration::from_secs(1)).map_err(failed)?;
        }
    }
}

/// The start of a hop.
#[derive(Debug)]
struct Output {
    publisher: Publisher<Ipc, [u64], ()>,
    notifier: Notifier<Ipc>,
    words: usize,
}

impl Output {
    fn open(node: &Node<Ipc>, hop: usize) -> anyhow::Result<Self> {
        let name = ServiceName::new(&format!("chain/{hop}")).map_err(failed)?;
        let words = BYTES[hop] / size_of::<u64>();
        let data =
            node.service_builder(&name).publish_subscribe::<[u64]>().open_or_create().map_err(failed)?;
        let publisher = data.publisher_builder().initial_max_slice_len(words).create().map_err(failed)?;
        let events = node.service_builder(&name).event().open_or_create().map_err(failed)?;
        Ok(Self { publisher, notifier: events.notifier_builder().create().map_err(failed)?, words })
    }

    /// Writes every word of a new frame, and its head at the last moment.
    fn send(&self, head: &[u64; HEAD]) -> anyhow::Result<()> {
        let loan = self.publisher.loan_slice_uninit(self.words).map_err(failed)?;
        let mut sample = loan.write_from_fn(|index| index as u64);
        let payload = sample.payload_mut();
        payload[..HEAD].copy_from_slice(head);
        payload[1] = now_ns().unsigned_abs();
        sample.send().map_err(failed)?;
        self.notifier.notify().map_err(failed)?;
        Ok(())
    }
}
