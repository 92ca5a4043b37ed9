//! Builds `octomap.cpp` where a C++ compiler and OctoMap's headers and library are installed (Debian: `liboctomap-dev`);
//! elsewhere the bench says that it has nothing to compare with.

use std::path::PathBuf;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=octomap.cpp");
    println!("cargo::rerun-if-changed=/usr/include/octomap/OcTree.h");
    println!("cargo::rerun-if-env-changed=CXX");
    let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".into());
    let program = PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default()).join("octomap");
    let built = Command::new(compiler)
        .args(["-std=c++17", "-O3", "-DNDEBUG", "octomap.cpp", "-loctomap", "-loctomath", "-o"])
        .arg(&program)
        .output();
    let program = match built {
        Ok(output) if output.status.success() => program.display().to_string(),
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stderr);
            println!(
                "cargo::warning=octomap.cpp was not built: {}",
                text.lines().next().unwrap_or("no reason given")
            );
            String::new()
        }
        Err(cause) => {
            println!("cargo::warning=octomap.cpp was not built: {cause}");
            String::new()
        }
    };
    println!("cargo::rustc-env=OCTOMAP_PROGRAM={program}");
}
