//! Both ends of a hop over Zenoh's shared memory, one process each; the bench `ipc_hop` starts the first and reads its times.
//!
//!     evac-zenoh-hop ping POINTS transport|write-and-sum thread|callback FOLDER
//!
//! For each line with a number on standard input so many round trips are made, and one line a trip comes back: half of it in nanoseconds,
//! from handing a frame over to having it in the other process. `thread`: frames are received by a thread of the program that sleeps
//! until one comes, as a stage does. `callback`: by a function that Zenoh calls in its own thread, which saves a wake-up, and over its
//! low-latency transport.

mod frame;

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use rustix::process::{Signal, set_parent_process_death_signal};
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use crate::frame::{Case, Output, Stamps, failed, now_ns};

const THERE: &str = "bench/there";
const BACK: &str = "bench/back";
const READY: &str = "ready";
/// In the place of a stamp: the peer is to end.
const DONE: i64 = -1;
/// A peer that is silent for this long is broken.
const PATIENCE: Duration = Duration::from_secs(10);

fn main() -> anyhow::Result<()> {
    // Never to outlive the bench.
    set_parent_process_death_signal(Some(Signal::KILL))?;
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [end, points, measure, wake_up, folder] = &arguments.iter().map(String::as_str).collect::<Vec<_>>()[..]
    else {
        bail!("usage: evac-zenoh-hop ping POINTS transport|write-and-sum thread|callback FOLDER");
    };
    let case = Case { points: points.parse()?, is_read: *measure == "write-and-sum" };
    let in_callback = *wake_up == "callback";
    let session = open(folder, *end == "ping", in_callback)?;
    match *end {
        "ping" => {
            let peer = Peer::start(&arguments)?;
            ping(&session, case, in_callback)?;
            peer.finish()?;
        }
        "serve" => serve(&session, case, in_callback)?,
        other => bail!("'{other}' is no end of a hop"),
    }
    session.close().wait().map_err(failed)
}

/// Two peers that know each other by a socket in `folder`, over which only Zenoh's messages go.
fn open(folder: &str, listens: bool, low_latency: bool) -> anyhow::Result<Session> {
    let mut config = zenoh::Config::default();
    let place = format!("[\"unixsock-stream/{folder}/zenoh.sock\"]");
    let (mine, other) = if listens { ("listen/endpoints", "connect/endpoints") } else { ("connect/endpoints", "listen/endpoints") };
    for (key, value) in [
        ("mode", "\"peer\""),
        ("scouting/multicast/enabled", "false"),
        ("transport/shared_memory/enabled", "true"),
        ("transport/shared_memory/mode", "\"init\""),
        ("transport/unicast/lowlatency", if low_latency { "true" } else { "false" }),
        ("transport/unicast/qos/enabled", if low_latency { "false" } else { "true" }),
        (mine, place.as_str()),
        (other, "[]"),
    ] {
        config.insert_json5(key, value).map_err(failed).with_context(|| format!("{key} = {value}"))?;
    }
    zenoh::open(config).wait().map_err(failed)
}

fn output(session: &Session, key: &'static str, case: Case) -> anyhow::Result<Output> {
    // Nothing is dropped and nothing waits for more to be sent together.
    let publisher = session.declare_publisher(key).congestion_control(CongestionControl::Block).express(true);
    Output::new(publisher.wait().map_err(failed)?, case)
}

/// What the frames of a service have said when, in order: stamps of the frame and when it was readable. The subscriber has to be kept.
type Heard = (Subscriber<()>, Receiver<anyhow::Result<(Stamps, i64)>>);

/// Gives what comes to `take` as soon as it is readable, in Zenoh's thread.
fn listen(
    session: &Session,
    key: &'static str,
    case: Case,
    take: impl Fn(&Stamps, i64) -> anyhow::Result<()> + Send + Sync + 'static,
) -> anyhow::Result<Heard> {
    let (heard, receiver) = channel();
    let expected_sum = case.expected_sum();
    let subscriber = session.declare_subscriber(key).callback(move |sample| {
        let received_ns = now_ns();
        let read = case.read(&sample, expected_sum).and_then(|stamps| {
            take(&stamps, received_ns)?;
            Ok((stamps, received_ns))
        });
        // Who does not listen any more has ended.
        let _ = heard.send(read);
    });
    Ok((subscriber.wait().map_err(failed)?, receiver))
}

/// Answers every frame with one of the same length until it is told that it is done.
fn serve(session: &Session, case: Case, in_callback: bool) -> anyhow::Result<()> {
    let back = output(session, BACK, case)?;
    if in_callback {
        let answer = move |stamps: &Stamps, received_ns| {
            if stamps.arrival_ns != DONE { back.send(received_ns).map(|_| ()) } else { Ok(()) }
        };
        let (_subscriber, heard) = listen(session, THERE, case, answer)?;
        say_ready()?;
        while heard.recv()??.0.arrival_ns != DONE {}
        return Ok(());
    }
    let expected_sum = case.expected_sum();
    let there = session.declare_subscriber(THERE).wait().map_err(failed)?;
    say_ready()?;
    loop {
        let sample = there.recv().map_err(failed)?;
        let received_ns = now_ns();
        if case.read(&sample, expected_sum)?.arrival_ns == DONE {
            return Ok(());
        }
        // Borrowed memory goes back before the answer, as a stage's does.
        drop(sample);
        back.send(received_ns)?;
    }
}

fn ping(session: &Session, case: Case, in_callback: bool) -> anyhow::Result<()> {
    let there = output(session, THERE, case)?;
    let expected_sum = case.expected_sum();
    let receive: Box<dyn Fn() -> anyhow::Result<(Stamps, i64)>> = if in_callback {
        let (subscriber, heard) = listen(session, BACK, case, |_, _| Ok(()))?;
        Box::new(move || {
            let _kept = &subscriber;
            heard.recv_timeout(PATIENCE).context("the peer does not answer")?
        })
    } else {
        let subscriber = session.declare_subscriber(BACK).wait().map_err(failed)?;
        Box::new(move || {
            let sample = subscriber.recv_timeout(PATIENCE).map_err(failed)?.context("the peer does not answer")?;
            let received_ns = now_ns();
            Ok((case.read(&sample, expected_sum)?, received_ns))
        })
    };
    let mut stdout = std::io::stdout().lock();
    let mut times = Vec::new();
    for line in std::io::stdin().lines() {
        times.clear();
        for _ in 0..line?.parse::<u64>()? {
            let start_ns = now_ns();
            let sent_ns = there.send(0)?;
            let (answer, received_ns) = receive()?;
            let both = if case.is_read {
                now_ns() - start_ns
            } else {
                (answer.arrival_ns - sent_ns) + (received_ns - answer.sent_ns)
            };
            times.push(both / 2);
        }
        for time in &times {
            writeln!(stdout, "{time}")?;
        }
        stdout.flush()?;
    }
    there.send(DONE)?;
    Ok(())
}

/// The other end; dropping it ends it.
struct Peer(Child);

impl Peer {
    fn start(arguments: &[String]) -> anyhow::Result<Self> {
        let mut child = Command::new(std::env::current_exe()?)
            .arg("serve")
            .args(&arguments[1..])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()?;
        let stdout = child.stdout.take().ok_or_else(|| anyhow!("the peer has no output"))?;
        let peer = Self(child);
        let mut line = String::new();
        BufReader::new(stdout).read_line(&mut line)?;
        anyhow::ensure!(line.trim() == READY, "the peer did not get ready");
        Ok(peer)
    }

    /// Waits for one that was told that it is done: it gives its shared memory back.
    fn finish(mut self) -> std::io::Result<()> {
        self.0.wait().map(|_| ())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended by itself; either way it is reaped here.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn say_ready() -> anyhow::Result<()> {
    let mut stdout = std::io::stdout();
    writeln!(stdout, "{READY}")?;
    Ok(stdout.flush()?)
}
