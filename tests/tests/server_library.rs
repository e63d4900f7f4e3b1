//! Clients' documents in the server's library: what is refused, who sees them, and that flights use them.

use rotortwin_tests::program::{Call, Link};
use rotortwin_tests::scratch::{Scratch, repository, shipped_scenario};
use rotortwin_tests::server::{Answer, Server};
use serde_json::{Value, json};

fn config(path: &str) -> String {
    std::fs::read_to_string(repository().join("config").join(path)).expect("readable")
}

fn put(server: &Server, path: &str, headers: &[(&str, &str)], text: &str) -> Answer {
    let mut all = vec![("content-type", "application/toml")];
    all.extend_from_slice(headers);
    server.ask("PUT", &format!("/api/v1/{path}"), &all, text)
}

fn header<'a>(answer: &'a Answer, name: &str) -> &'a str {
    answer
        .headers
        .lines()
        .filter_map(|line| line.split_once(": "))
        .find(|(key, _)| key.eq_ignore_ascii_case(name))
        .map_or("", |(_, value)| value.trim())
}

fn fly(server: &Server, body: &Value) -> Value {
    let id = server.submit(body);
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");
    run
}

/// A hover of 12 s with a custom vehicle: the documents, and the flight that uses them.
#[test]
fn scenario_a_vehicle_and_a_scenario_of_ones_own_fly() {
    let scratch = Scratch::new();
    let mut server = Server::start(&scratch.path("data"));
    let heavy = config("vehicles/f550.toml").replace("mass_kg = 1.55", "mass_kg = 1.95");
    let made = put(&server, "vehicles/heavy", &[], &heavy);
    assert_eq!(made.status, 201, "{}", made.json());
    assert_eq!(header(&made, "location"), "/api/v1/vehicles/heavy");
    let vehicles = server.get("/api/v1/vehicles");
    assert_eq!(vehicles["own"], json!(["heavy"]));
    assert!(
        vehicles["items"]
            .as_array()
            .is_some_and(|all| all.contains(&json!("f550"))),
        "{vehicles}"
    );

    let scenario = config("scenarios/short-hover.toml").replace("../vehicles/f550.toml", "../vehicles/heavy.toml");
    assert_eq!(put(&server, "scenarios/heavy-hover", &[], &scenario).status, 201);
    let flight = json!({ "scenario": "heavy-hover", "link": "in-process" });
    let run = fly(&server, &flight);
    let text = json!({ "text": scenario, "link": "in-process" });
    assert_eq!(run["run_hash"], fly(&server, &text)["run_hash"], "by name and by text");
    let light = json!({ "scenario": "short-hover", "link": "in-process" });
    assert_ne!(run["run_hash"], fly(&server, &light)["run_hash"], "the mass counts");

    // Stored documents survive the server; a task on a worker reads them, too.
    server.kill();
    server.start_again(&scratch.path("data"));
    assert_eq!(server.get("/api/v1/scenarios")["own"], json!(["heavy-hover"]));
    let campaign = "name = \"heavy\"\ndescription = \"two\"\nscenario = \"../scenarios/heavy-hover.toml\"\nseed = 1\nflights = 2\n";
    let id = server.submit_to("campaigns", &json!({ "text": campaign }));
    let campaign = server.ended_in("campaigns", &id);
    assert_eq!(campaign["status"], "done", "{campaign}");

    // The run stores its documents: it can be repeated after they are deleted.
    let gone = server.ask("DELETE", "/api/v1/vehicles/heavy", &[], "");
    assert_eq!(gone.status, 204);
    let refused = server.ask("POST", "/api/v1/runs", &[], &flight.to_string());
    assert_eq!(refused.status, 422);
    assert!(
        refused.json()["detail"]
            .as_str()
            .is_some_and(|why| why.contains("vehicles/heavy.toml")),
        "{}",
        refused.json()
    );
    let id = run["id"].as_str().expect("an id");
    let again = server.ask("POST", &format!("/api/v1/runs/{id}/verify"), &[], "");
    assert_eq!(again.json()["same"], true, "{}", again.json());
    assert_eq!(
        server.ask("DELETE", "/api/v1/vehicles/f550", &[], "").status,
        404,
        "the server's own"
    );
}

#[test]
fn scenario_a_bad_document_is_refused_with_all_that_is_wrong() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let vehicle = config("vehicles/f550.toml")
        .replace("mass_kg = 1.55", "mass_kg = -1.55")
        .replace("moment_ratio_m = 0.016", "moment_ratio_m = 16");
    let refused = put(&server, "vehicles/bad", &[], &vehicle);
    assert_eq!(refused.status, 422);
    let complaints = refused.json()["complaints"].clone();
    assert_eq!(complaints.as_array().map(Vec::len), Some(2), "{complaints}");
    assert!(complaints.to_string().contains("body.mass_kg"), "{complaints}");
    assert!(complaints.to_string().contains("moment_ratio_m"), "{complaints}");
    assert_eq!(server.get("/api/v1/vehicles")["own"], json!([]), "nothing is kept");

    let scenario = config("scenarios/short-hover.toml").replace("duration_s", "colour = 1\nduration_s")
        + "\n[[fault]]\ntime_s = 2.0\nrotor = 17\nblade = \"b\"\n";
    let dry = server.ask(
        "POST",
        "/api/v1/scenarios/validate",
        &[],
        &json!({ "text": scenario }).to_string(),
    );
    let found = dry.json();
    assert_eq!(found["valid"], false);
    let keys: Vec<&str> = found["complaints"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|one| one["key"].as_str())
        .collect();
    assert_eq!(keys, ["colour", "fault[0].rotor"], "{found}");
    assert!(
        found["complaints"][1]["line"].as_u64().is_some_and(|line| line > 3),
        "{found}"
    );

    for (path, text, status, words) in [
        (
            "vehicles/escape",
            config("vehicles/f550.toml").replace("../blades/t9545.toml", "/etc/passwd"),
            422,
            "outside the library",
        ),
        (
            "scenarios/escape",
            "vehicle = \"../../../x.toml\"\n".to_owned(),
            422,
            "outside the library",
        ),
        (
            "models/escape",
            "model_format = 1\nname = \"x\"\n[vehicle_file]\npath = \"/etc/passwd\"\nhash = \"0\"\n".to_owned(),
            422,
            "self-contained",
        ),
        ("effects/none", "id = \"x\"\n".to_owned(), 422, "name"),
        (
            "blades/none",
            "description = \"x\"\n[blade.a]\n".to_owned(),
            422,
            "blade.a",
        ),
        ("vehicles/UPPER", config("vehicles/f550.toml"), 400, "name"),
        ("vehicles/%2e%2e%2fx", config("vehicles/f550.toml"), 400, "name"),
        ("scenarios/large", "#".repeat(300 << 10), 413, "at most"),
    ] {
        let answer = put(&server, path, &[], &text);
        assert_eq!(answer.status, status, "{path}: {}", answer.json());
        let detail = answer.json()["detail"].clone();
        assert!(
            detail.as_str().is_some_and(|detail| detail.contains(words)),
            "{path}: {detail}"
        );
    }
}

#[test]
fn scenario_nobody_overwrites_what_he_has_not_seen() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let (one, two) = (
        config("effects/fin-drag.toml"),
        config("effects/fin-drag.toml") + "# two\n",
    );
    let absent = [("if-none-match", "*")];
    let first = put(&server, "effects/fin", &absent, &one);
    assert_eq!(first.status, 201);
    assert_eq!(put(&server, "effects/fin", &absent, &two).status, 412);
    let tag = header(&first, "etag").to_owned();
    assert_eq!(put(&server, "effects/fin", &[("if-match", &tag)], &two).status, 200);
    assert_eq!(
        put(&server, "effects/fin", &[("if-match", &tag)], &one).status,
        412,
        "somebody was faster"
    );
    let seen = server.ask("GET", "/api/v1/effects/fin", &[], "");
    assert_eq!(seen.body, two.as_bytes());
    assert_eq!(
        put(&server, "effects/fin", &[("if-match", header(&seen, "etag"))], &one).status,
        200
    );
    assert_eq!(put(&server, "effects/fin", &[("if-match", "fin")], &one).status, 400);
    // Nor does he delete it.
    let delete = |tag: &str| {
        server
            .ask("DELETE", "/api/v1/effects/fin", &[("if-match", tag)], "")
            .status
    };
    assert_eq!(delete(header(&seen, "etag")), 412);
    let now = server.ask("GET", "/api/v1/effects/fin", &[], "");
    assert_eq!((now.status, delete(header(&now, "etag"))), (200, 204));
    assert_eq!(server.ask("GET", "/api/v1/effects/fin", &[], "").status, 404);
}

#[test]
fn scenario_effects_and_models_of_ones_own() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let own = config("effects/fin-drag.toml").replace("id = \"fin-drag\"", "id = \"keel-drag\"");
    assert_eq!(put(&server, "effects/keel-drag", &[], &own).status, 201);
    let catalogue = server.get("/api/v1/catalogue");
    let ids: Vec<&str> = catalogue["items"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|one| one["id"].as_str())
        .collect();
    assert!(ids.contains(&"keel-drag") && ids.contains(&"rotor-drag"), "{ids:?}");

    // A version as the command line writes it: 10 % heavier, which the detectors do not know.
    let f550 = repository().join("config/vehicles/f550.toml");
    let call = |words: &[&str]| {
        let models = scratch.path("models");
        Call::new(&scratch, words)
            .with(["--models".into(), models.into_os_string()])
            .run()
            .expect_code(0)
            .stdout
    };
    call(&["model", "add", &f550.display().to_string(), "mass", "share=0.1"]);
    let version = call(&["model", "export", "f550"]);
    let made = put(&server, "models/heavy", &[], &version);
    assert_eq!(made.status, 201, "{}", made.json());
    let flight = |more: Value| {
        let mut body = json!({ "scenario": "short-hover", "link": "in-process" });
        body.as_object_mut()
            .expect("an object")
            .extend(more.as_object().expect("an object").clone());
        fly(&server, &body)["run_hash"].as_str().expect("a hash").to_owned()
    };
    let plain = flight(json!({}));
    let heavy = flight(json!({ "model": { "model": "heavy" } }));
    let both = flight(json!({ "model": { "version": version }, "fdi_model": { "model": "heavy" } }));
    assert_ne!(plain, heavy, "the plant is heavier");
    assert_ne!(heavy, both, "the detectors know");
    let local = Call::fly(&scratch, Link::InProcess, &shipped_scenario("short-hover"), "local")
        .with(["--model", "f550", "--models"])
        .with([scratch.path("models")])
        .run()
        .expect_code(0);
    assert_eq!(local.run_hash(), heavy, "as the command line flies it");
}

#[test]
fn scenario_documents_belong_to_an_account() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let token = |tenant: &str| {
        let data = data.display().to_string();
        let made = Call::new(
            &scratch,
            ["token", "create", "--data", &data, tenant, "--tenant", tenant],
        );
        format!("Bearer {}", made.run().expect_code(0).stdout.trim())
    };
    let (anna, bert) = (token("anna"), token("bert"));
    let vehicle = config("vehicles/f550.toml");
    let made = put(&server, "vehicles/mine", &[("authorization", &anna)], &vehicle);
    assert_eq!(made.status, 201, "{}", made.json());
    let ask = |method: &str, token: &str| {
        server
            .ask(method, "/api/v1/vehicles/mine", &[("authorization", token)], "")
            .status
    };
    assert_eq!((ask("GET", &anna), ask("GET", &bert)), (200, 404));
    assert_eq!((ask("DELETE", &bert), ask("DELETE", &anna)), (404, 204));
    assert_eq!(ask("GET", &anna), 404);
}
