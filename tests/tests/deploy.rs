//! Files for containers: what they call exists, and no container runs with more rights than it needs. (That they work was tried by hand:
//! docs/deploy.md.)

use rotortwin_tests::program::Call;
use rotortwin_tests::scratch::{Scratch, repository};
use std::path::PathBuf;

fn manifests() -> Vec<PathBuf> {
    let folder = repository().join("deploy/kubernetes");
    let entries = std::fs::read_dir(folder).expect("it is in the repository");
    entries.map(|entry| entry.expect("it can be read").path()).collect()
}

/// Words of lists such as `args: [worker, --roles, jobs]` behind `key` that call the program.
fn calls(text: &str, key: &str) -> Vec<Vec<String>> {
    let mut calls = Vec::new();
    for rest in text.split(&format!("{key}: [")).skip(1) {
        let (list, _) = rest.split_once(']').expect("a list ends");
        let words = list.split(',').map(|word| word.trim().trim_matches('"').to_owned());
        let words: Vec<String> = words.skip_while(|word| word == "rotortwin").collect();
        if matches!(
            words.first().map(String::as_str),
            Some("serve" | "worker" | "router" | "health")
        ) {
            calls.push(words);
        }
    }
    calls
}

#[test]
fn val_containers_call_what_the_program_has() {
    let scratch = Scratch::new();
    let mut files = manifests();
    files.push(repository().join("docker-compose.yml"));
    let mut count = 0;
    for file in files {
        let text = std::fs::read_to_string(&file).expect("it is text");
        for key in ["command", "args", "test"] {
            // `test: [CMD, rotortwin, …]` of the compose file.
            for call in calls(&text.replace("[CMD, ", "["), key) {
                let help = Call::new(&scratch, [call[0].as_str(), "--help"])
                    .run()
                    .expect_code(0)
                    .stdout;
                for option in call.iter().filter(|word| word.starts_with("--")) {
                    let known = help.split([' ', '\n', ',']).any(|word| word == option);
                    assert!(known, "{}: rotortwin {} has no {option}", file.display(), call[0]);
                }
                count += 1;
            }
        }
    }
    assert!(count >= 15, "only {count} calls were found");
}

#[test]
fn val_containers_have_no_rights_to_spare() {
    let count = |text: &str, words: &str| text.matches(words).count();
    for file in manifests() {
        let text = std::fs::read_to_string(&file).expect("it is text");
        let containers = count(&text, "          image: ");
        for words in [
            "readOnlyRootFilesystem: true",
            "allowPrivilegeEscalation: false",
            "capabilities: {drop: [ALL]}",
            "runAsNonRoot: true",
        ] {
            assert_eq!(count(&text, words), containers, "{}: {words}", file.display());
        }
    }
    let compose = std::fs::read_to_string(repository().join("docker-compose.yml")).expect("it is text");
    let (_, services) = compose.split_once("\nservices:\n").expect("it has services");
    let (services, _) = services.split_once("\nnetworks:\n").expect("and networks");
    let names = services
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   ") && line.ends_with(':'));
    // The database has its own; all others share one block.
    assert_eq!(names.count(), count(services, "<<: *program") + 1);
    for words in ["read_only: true", "cap_drop: [ALL]", "no-new-privileges:true"] {
        assert_eq!(count(&compose, words), 2, "{words}");
    }
    let image = std::fs::read_to_string(repository().join("Dockerfile")).expect("it is text");
    assert!(image.contains("\nUSER 10001:10001\n"), "the image runs as root");
}
