//! Builds `octomap.cpp` and `conversion.cpp` where a C++ compiler and OctoMap's headers and library are installed (Debian:
//! `liboctomap-dev`); elsewhere the benches say that they have nothing to compare with.

use std::path::PathBuf;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=/usr/include/octomap/OcTree.h");
    println!("cargo::rerun-if-env-changed=CXX");
    for (name, variable) in [("octomap", "OCTOMAP_PROGRAM"), ("conversion", "CONVERSION_PROGRAM")] {
        println!("cargo::rerun-if-changed={name}.cpp");
        println!("cargo::rustc-env={variable}={}", build(name));
    }
}

/// The program's path, empty where it could not be built.
fn build(name: &str) -> String {
    let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".into());
    let program = PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default()).join(name);
    let source = format!("{name}.cpp");
    let built = Command::new(compiler)
        .args(["-std=c++17", "-O3", "-DNDEBUG", &source, "-loctomap", "-loctomath", "-o"])
        .arg(&program)
        .output();
    match built {
        Ok(output) if output.status.success() => program.display().to_string(),
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stderr);
            println!(
                "cargo::warning={source} was not built: {}",
                text.lines().next().unwrap_or("no reason given")
            );
            String::new()
        }
        Err(cause) => {
            println!("cargo::warning={source} was not built: {cause}");
            String::new()
        }
    }
}
