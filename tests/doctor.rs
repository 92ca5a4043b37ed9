//! `evac doctor` on this machine, with a module on a pseudo-terminal and a stage that was killed.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::net::Ipv4Addr;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::process::Command;
use std::time::{Duration, Instant};

use common::{Bench, Running, WATCHDOG};
use evac_simulator::devices::livox::{LivoxConfig, LivoxDevice, LivoxProtocol, Wall};
use evac_simulator::devices::wt901c;
use serde_json::Value;

/// The findings on a topic: grade, text and remedy.
fn findings(json: &Value, topic: &str) -> Vec<(String, String, String)> {
    let word = |finding: &Value, key: &str| finding[key].as_str().unwrap().to_owned();
    let all = json["findings"].as_array().unwrap().iter().filter(|finding| finding["topic"] == topic);
    all.map(|finding| (word(finding, "grade"), word(finding, "text"), word(finding, "remedy"))).collect()
}

fn doctor(bench: &Bench, args: &[&str]) -> (i32, Value) {
    let ended = bench.run(["doctor", "--json"].iter().chain(args));
    (ended.code, serde_json::from_str(&ended.stdout).unwrap())
}

#[test]
fn the_devices_of_a_pipeline_file_are_looked_at_and_an_absent_one_is_a_fault_with_a_remedy() {
    let bench = Bench::new();
    let port = bench.path("evac-imu");
    let file = format!(
        "domain = \"{}\"\n[[stage]]\nkind = \"imu\"\n[stage.config]\nport = \"{}\"\n",
        bench.domain.name(),
        port.display()
    );
    bench.write("robot.toml", file);
    let (code, json) = doctor(&bench, &["robot.toml"]);
    assert_eq!((code, &json["can_run"]), (4, &Value::Bool(false)));
    let imu = findings(&json, "imu");
    assert_eq!(imu.len(), 1, "{imu:?}");
    assert!(imu[0].0 == "fault" && imu[0].1.contains("evac-imu") && imu[0].2.contains("by-id"), "{imu:?}");

    let at_rest = |_| ([0, 0, 2048], [0; 3]);
    let module = wt901c::Bench::start(&port, wt901c::Module::new(wt901c::Line::Serial), at_rest).unwrap();
    let (_, json) = doctor(&bench, &["robot.toml"]);
    let imu = findings(&json, "imu");
    assert!(imu[0].0 == "good" && imu[0].1.contains("9600 baud"), "{imu:?}");
    // It was only listened to.
    assert_eq!(module.port().module.baud(), 9600);
    assert!(
        findings(&json, "serial port")
            .iter()
            .any(|(grade, text, _)| grade == "good" && text.contains("evac-imu"))
    );

    module.port().faults = wt901c::Faults { silent: true, ..wt901c::Faults::default() };
    let (code, json) = doctor(&bench, &["robot.toml"]);
    let imu = findings(&json, "imu");
    assert!(code == 4 && imu[0].0 == "fault" && imu[0].1.contains("no WT901C at any speed"), "{imu:?}");
}

#[test]
fn what_a_killed_stage_left_is_named_until_it_is_cleaned_and_a_living_one_is_left_alone() {
    let bench = Bench::new();
    let name = bench.domain.name().to_owned();
    let mut stage = bench.evac(["stage", "deskewer", "--domain", &name]).spawn().unwrap();
    let until = Instant::now() + WATCHDOG;
    while bench.leftovers().len() < 10 {
        assert!(Instant::now() < until, "the stage opens no services");
        std::thread::sleep(Duration::from_millis(20));
    }
    let about_us = |json: &Value| {
        let all = findings(json, "shared memory");
        all.into_iter().find(|(_, text, _)| text.contains(&format!("'{name}'")))
    };
    assert_eq!(about_us(&doctor(&bench, &[]).1), None);
    stage.kill().unwrap();
    stage.wait().unwrap();
    let (_, json) = doctor(&bench, &[]);
    let (grade, text, remedy) = about_us(&json).unwrap();
    assert!(grade == "advice" && text.contains("files") && remedy.contains("--clean"), "{text}");
    assert!(!bench.leftovers().is_empty());
    // Only ours: other tests on this machine leave and clean what is theirs.
    let (_, json) = doctor(&bench, &["--clean", "--domain", &name]);
    let memory = findings(&json, "shared memory");
    assert!(memory.iter().any(|(_, text, _)| text.contains("1 dead domains removed")), "{memory:?}");
    assert_eq!((about_us(&doctor(&bench, &[]).1), bench.leftovers()), (None, Vec::new()));
}

#[test]
fn a_lidar_of_either_protocol_is_found_and_an_absent_one_is_a_fault() {
    for (number, protocol, name) in [(0, LivoxProtocol::Sdk1, "sdk1"), (2, LivoxProtocol::Sdk2, "sdk2")] {
        let bench = Bench::new();
        let [_, a, b, c] = (std::process::id() << 2 | number).to_be_bytes();
        let (host, address) = (Ipv4Addr::new(127, a | 0x60, b, c), Ipv4Addr::new(127, a | 0x60, b, c | 1));
        let file = format!(
            "[[stage]]\nkind = \"lidar\"\n[stage.config]\nprotocol = \"{name}\"\ninterface = \"{host}\"\ndevice = \"{address}\"\n"
        );
        bench.write("robot.toml", file);
        let config = LivoxConfig { protocol, address, broadcast_to: host, ..LivoxConfig::default() };
        let serial = config.serial.clone();
        let device = LivoxDevice::start(config, Box::new(Wall)).unwrap();
        let (_, json) = doctor(&bench, &["robot.toml"]);
        let lidar = findings(&json, "lidar");
        let found = lidar.last().unwrap();
        assert!(
            found.0 == "good" && found.1.contains(&serial) && found.1.contains(&address.to_string()),
            "{lidar:?}"
        );
        drop(device);
        let (code, json) = doctor(&bench, &["robot.toml"]);
        let lidar = findings(&json, "lidar");
        let found = lidar.last().unwrap();
        assert!(code == 4 && found.0 == "fault" && found.1.contains(&format!("not {address}")), "{lidar:?}");
    }
}

#[test]
fn a_serial_port_that_the_user_may_not_use_is_named_with_its_group() {
    let bench = Bench::new();
    let port = bench.path("evac-imu");
    let at_rest = |_| ([0, 0, 2048], [0; 3]);
    let _module = wt901c::Bench::start(&port, wt901c::Module::new(wt901c::Line::Serial), at_rest).unwrap();
    bench.write(
        "robot.toml",
        format!("[[stage]]\nkind = \"imu\"\n[stage.config]\nport = \"{}\"\n", port.display()),
    );
    let mode = |path: &std::path::Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    };
    mode(&std::fs::canonicalize(&port).unwrap(), 0o000);
    let mut command = bench.evac(["doctor", "--json", "robot.toml"]);
    if rustix::process::getuid().is_root() {
        // Root may do everything: somebody else looks.
        mode(bench.path("").as_path(), 0o755);
        command.uid(65_534).gid(65_534);
    }
    let output = match command.output() {
        Ok(output) => output,
        Err(cause) => return println!("skipped: evac cannot be run as another user: {cause}"),
    };
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let found = findings(&json, "serial port");
    let ours = found.iter().find(|(_, text, _)| text.contains("evac-imu")).unwrap();
    assert_eq!((output.status.code(), ours.0.as_str()), (Some(4), "fault"), "{found:?}");
    assert!(ours.1.contains("mode 0") && ours.2.contains("usermod -aG"), "{ours:?}");
}

/// A network of two machines: this one has 192.168.1.50, and on the other one a simulated LiDAR. `$1` is evac, `$2` the LiDAR's
/// address, `$3` its protocol.
const TWO_MACHINES: &str = r#"
ip link set lo up
ip link add lidar0 type veth peer name host0
unshare --net sleep 300 & other=$!
trap 'kill $other $device 2>/dev/null' EXIT
here=$(readlink /proc/self/ns/net)
until there=$(readlink /proc/$other/ns/net) && [ "$there" != "$here" ]; do sleep 0.05; done
ip link set lidar0 netns $other
ip addr add 192.168.1.50/24 dev host0
echo 1 > /proc/sys/net/ipv4/conf/host0/rp_filter
ip link set host0 up
nsenter -t $other -n ip addr add $2/24 dev lidar0
nsenter -t $other -n ip link set lidar0 up
nsenter -t $other -n ip link set lo up
nsenter -t $other -n "$1" stage device_simulator --config device-$3.toml --domain $4 2>device.log & device=$!
until nsenter -t $other -n grep -qiE ':(FDE8|DAC0) ' /proc/net/udp || ! kill -0 $device; do sleep 0.05; done
"$1" doctor --json robot-$3.toml
"#;

#[test]
fn a_lidar_whose_packets_are_eaten_on_this_machine_is_told_from_one_that_is_silent() {
    let usable = Command::new("unshare").args(["--net", "nsenter", "--version"]).output();
    let has_ip = Command::new("ip").arg("-V").output().is_ok();
    if !(has_ip && usable.is_ok_and(|output| output.status.success())) {
        return println!("skipped: no network namespaces here (unshare, nsenter and ip as root)");
    }
    let bench = Bench::new();
    for protocol in ["sdk1", "sdk2"] {
        let stage = |kind: &str| format!("mode = \"live\"\n[[stage]]\nkind = \"{kind}\"\n[stage.config]\n");
        let lidar = format!("protocol = \"{protocol}\"\ninterface = \"192.168.1.50\"\n");
        bench.write(&format!("robot-{protocol}.toml"), stage("lidar") + &lidar);
        let run = |address: &str| {
            let device = format!(
                "walk.duration_s = 1.0\nlidar = {{ imu = true, protocol = \"{protocol}\", address = \"{address}\", broadcast_to = \"255.255.255.255\" }}\n"
            );
            bench.write(&format!("device-{protocol}.toml"), stage("device_simulator") + &device);
            let evac = env!("CARGO_BIN_EXE_evac");
            let mut command = Command::new("unshare");
            command.args([
                "--net",
                "sh",
                "-c",
                TWO_MACHINES,
                "sh",
                evac,
                address,
                protocol,
                bench.domain.name(),
            ]);
            command.current_dir(bench.path(""));
            let output = Running::start(command).end();
            let json: Value = serde_json::from_str(&output.stdout)
                .unwrap_or_else(|_| panic!("{}{}{}", output.stdout, output.stderr, bench.text("device.log")));
            findings(&json, "lidar").pop().unwrap()
        };
        let (grade, text, _) = run("192.168.1.12");
        assert!(grade == "good" && text.contains("at 192.168.1.12"), "{protocol}: {text}");
        if protocol == "sdk1" {
            // From a network that this machine is not in: the reverse path filter drops what comes, as a firewall would.
            let (grade, text, remedy) = run("192.168.9.12");
            assert!(
                grade == "fault" && text.contains("192.168.9.12") && text.contains("not its programs"),
                "{text}"
            );
            assert!(remedy.contains("firewall") && remedy.contains("reverse path"), "{remedy}");
        }
    }
    drop(bench.domain.lock().unwrap());
}

#[test]
fn every_advice_says_what_to_do_and_the_text_is_what_the_json_says() {
    let bench = Bench::new();
    let (_, json) = doctor(&bench, &[]);
    for topic in ["shared memory", "clock", "processor", "serial port", "lidar"] {
        let found = findings(&json, topic);
        assert!(!found.is_empty(), "{topic}");
        assert!(found.iter().all(|(grade, _, remedy)| grade == "good" || !remedy.is_empty()), "{found:?}");
    }
    let ended = bench.run(["doctor", "no/such/file.toml"]);
    assert!(ended.code == 4 && ended.stdout.contains("no/such/file.toml"), "{}", ended.stdout);
    assert!(ended.stderr.contains("would stop a run"), "{}", ended.stderr);
}
