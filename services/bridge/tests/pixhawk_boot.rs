//! The linked Pixhawk 6C program in a model of a bare Cortex-M7: `tools/boot-pixhawk.py`, if `tools/processor-model.sh` could install the model.

use std::path::Path;
use std::process::Command;

#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../tests/src/skip.rs"]
mod skip;
use skip::skip;

#[test]
fn scenario_pixhawk_program_boots_and_answers_on_all_links() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let program = root.join("target/firmware/thumbv7em-none-eabihf/release/pixhawk6c");
    let python = root.join("target/processor-model/bin/python");
    if !program.is_file() {
        return skip("booting pixhawk6c: it was not built (cargo xtask firmware)");
    }
    if !python.is_file() {
        return skip("booting pixhawk6c: there is no model of the processor (tools/processor-model.sh)");
    }
    let output = Command::new(python)
        .arg(root.join("tools/boot-pixhawk.py"))
        .arg(program)
        .output()
        .expect("Python starts");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    for line in [
        "TELEM1: answers",
        "TELEM2: answers",
        "USB: answers",
        "a fault is reported",
        "restarts into the boot loader",
    ] {
        assert!(text.contains(&format!("ok   {line}")), "{text}");
    }
}
