//! Who may do what: a domain is one user's, requests are that user's, and a configuration cannot run a shell.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::io::{Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::{Bench, Running, wait_for};
use rustix::process::Signal;

/// `nobody`.
const OTHER_USER: u32 = 65_534;

fn pipeline(bench: &Bench) -> String {
    let mut text = format!("mode = \"live\"\ndomain = \"{}\"\n", bench.domain.name());
    for stage in ["simulator", "deskewer", "lio", "octree_mapper", "map_saver"] {
        text += &format!("[[stage]]\nkind = \"{stage}\"\n");
        if stage == "map_saver" {
            text += &format!("[stage.config]\noutput_dir = \"{}\"\n", bench.path("").display());
        }
    }
    bench.write("live.toml", text).to_str().unwrap().to_owned()
}

/// Everything that a domain has in shared memory and in its folder.
fn belongings(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = |folder: &Path| {
        std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect::<Vec<_>>()
    };
    let mut found: Vec<_> = entries(Path::new("/dev/shm"))
        .into_iter()
        .filter(|path| path.file_name().unwrap().to_string_lossy().starts_with(prefix))
        .collect();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        folders.extend(entries(&folder).into_iter().filter(|path| path.is_dir()));
        found.extend(entries(&folder).into_iter().filter(|path| !path.is_dir()));
    }
    found
}

/// Runs a command as another user; nothing where this one may not.
fn as_another_user(program: &str, args: &[&str]) -> Option<std::process::Output> {
    if !rustix::process::geteuid().is_root() {
        println!("skipped: only root can be another user");
        return None;
    }
    Some(Command::new(program).args(args).uid(OTHER_USER).gid(OTHER_USER).current_dir("/").output().unwrap())
}

#[test]
fn what_a_running_domain_owns_is_its_user_s_alone() {
    let bench = Bench::new();
    let up = Running::start(bench.evac(["up", &pipeline(&bench)]));
    let folder = bench.domain.folder();
    wait_for("the map saver's frames", || {
        let status = bench.run(["status", "--domain", bench.domain.name(), "--json"]).stdout;
        let status: serde_json::Value = serde_json::from_str(&status).ok()?;
        (status["stages"]["map_saver"]["frames"]["out"].as_u64() > Some(3)).then_some(())
    });
    assert_eq!(std::fs::metadata(&folder).unwrap().permissions().mode() & 0o777, 0o700);
    let all = belongings(&folder, &bench.domain.prefix());
    assert!(all.len() > 20, "{all:?}");
    let (mut sockets, mut checked) = (0, 0);
    for path in &all {
        // What goes away meanwhile is a connection that has ended.
        let Ok(metadata) = std::fs::symlink_metadata(path) else { continue };
        checked += 1;
        sockets += usize::from(metadata.file_type().is_socket());
        let mode = metadata.permissions().mode() & 0o777;
        // Nobody else gets into the folder.
        let others = if path.starts_with(&folder) { 0o022 } else { 0o077 };
        assert_eq!(mode & others, 0, "{}: {mode:o}", path.display());
        assert_eq!(metadata.uid(), rustix::process::geteuid().as_raw(), "{}", path.display());
    }
    assert!(checked > 20 && sockets > 0, "{checked} files, {sockets} sockets");
    let control = std::fs::metadata(folder.join("control.sock")).unwrap();
    assert_eq!(control.permissions().mode() & 0o777, 0o600);
    // The same from the other side.
    for path in all.iter().filter(|path| path.exists()).take(40) {
        let Some(output) = as_another_user("head", &["-c", "1", path.to_str().unwrap()]) else { break };
        assert!(!output.status.success() && output.stdout.is_empty(), "{}", path.display());
    }
    if let Some(output) = as_another_user("ls", &[folder.to_str().unwrap()]) {
        assert!(!output.status.success(), "{output:?}");
    }
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_launcher_takes_no_request_of_another_user_not_even_of_root() {
    if !rustix::process::geteuid().is_root() {
        println!("skipped: only root can be another user");
        return;
    }
    let bench = Bench::new();
    let name = bench.domain.name();
    let file = "mode = \"live\"\n[[stage]]\nkind = \"simulator\"\n[[stage]]\nkind = \"deskewer\"\n";
    let folder = tempfile::tempdir_in("/tmp").unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = folder.path().join("p.toml");
    std::fs::write(&path, file).unwrap();
    // The executable itself may lie where the other user cannot go.
    let evac = folder.path().join("evac");
    std::fs::copy(env!("CARGO_BIN_EXE_evac"), &evac).unwrap();
    let mut command = Command::new(&evac);
    command
        .args(["up", path.to_str().unwrap(), "--domain", name])
        .uid(OTHER_USER)
        .gid(OTHER_USER)
        .current_dir("/");
    let up = Running::start(command);
    let socket = PathBuf::from(format!("/tmp/evac-{OTHER_USER}/{name}/control.sock"));
    let mut stream = wait_for("the control socket", || UnixStream::connect(&socket).ok());
    stream.write_all(b"{\"order\":\"swap\",\"stage\":\"deskewer\",\"kind\":null,\"run\":null,\"config\":null,\"patience_s\":9.0}\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(
        answer.contains("failed") && answer.contains("user 65534") && answer.contains("user 0"),
        "{answer}"
    );
    up.signal(Signal::TERM);
    up.end();
}

#[test]
fn a_configuration_cannot_run_a_shell() {
    let bench = Bench::new();
    let script = bench
        .write("stage.sh", "#!/bin/sh\nprintf '%s\\n' \"$@\" > \"$(dirname \"$0\")/said.txt\"\nexit 4\n");
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
    let nasty = [
        "; touch pwned",
        "$(touch pwned)",
        "`touch pwned`",
        "| touch pwned",
        "&& touch pwned",
        "\\n touch pwned",
    ];
    let run: Vec<_> = nasty.iter().map(|word| format!("'{word}'")).collect();
    let text = format!(
        "domain = \"{}\"\n[[stage]]\nkind = \"simulator\"\nrun = ['{}', {}]\n",
        bench.domain.name(),
        script.display(),
        run.join(", ")
    );
    let file = bench.write("p.toml", text);
    let ended = bench.run(["up", file.to_str().unwrap()]);
    assert_ne!(ended.code, 0);
    let said = bench.text("said.txt");
    assert!(said.lines().take(nasty.len()).eq(nasty), "{said}");
    // As an executable each is a file of that name, which is not there.
    for word in nasty {
        let text = format!(
            "domain = \"{}\"\n[[stage]]\nkind = \"simulator\"\nrun = ['{word}']\n",
            bench.domain.name()
        );
        let file = bench.write("p.toml", text);
        let ended = bench.run(["up", file.to_str().unwrap()]);
        assert!(ended.code == 4 && ended.stderr.contains("cannot start"), "{} {}", ended.code, ended.stderr);
    }
    // Names of stages and domains go into paths and command lines.
    for (place, word) in [("name", "; touch pwned"), ("name", "../x"), ("kind", "$(touch pwned)")] {
        let kind = if place == "kind" { "" } else { "kind = 'simulator'\n" };
        let text = format!("[[stage]]\n{kind}{place} = '{word}'\n");
        let file = bench.write("p.toml", text);
        assert_eq!(bench.run(["up", file.to_str().unwrap()]).code, 3, "{place} {word}");
    }
    let file = pipeline(&bench);
    bench.run(["up", &file, "--domain", "$(touch pwned)"]).expect_error(3, &["domain"]);
    let everywhere = [
        bench.path("pwned"),
        PathBuf::from("pwned"),
        PathBuf::from("/pwned"),
        bench.domain.folder().join("pwned"),
    ];
    assert!(everywhere.iter().all(|path| !path.exists()));
}
