use super::*;

fn result(passed: bool, broken: &str) -> String {
    format!(
        r#"{{"commit":"c0ffee","passed":{passed},"reproduce":"hil-sim tune --motor link","motors":[{{"motor":"link","passed":{passed},
        "properties":{{"KP":150,"KD":700}},"start":{{"KP":120,"KD":640}},"set":{{"MKA":1300}},"candidates":9,
        "validation":{{"plants":1000,"first_seed":524288,"cost_start":0.5,"cost_tuned":0.25,"improvement_percent":50.0,"broken":[{broken}]}}}}]}}"#
    )
}

fn exported() -> Tuned {
    Tuned::of_result("DIR/tuned.json", &result(true, "")).expect("passed")
}

#[test]
fn export_reads_back_with_the_values_it_rests_on() {
    let tuned = exported();
    let text = tuned.text();
    assert_eq!(Tuned::parse("tuned.json", &text), Ok(tuned.clone()), "{text}");
    let motor = &tuned.motors[0];
    assert_eq!(motor.kind(), Some(MotorKind::Link));
    assert_eq!(motor.values(), [(Property::KD, 700), (Property::KP, 150), (Property::MKA, 1300)]);
    assert_eq!(motor.tuned_from.len(), 2);
    assert_eq!((tuned.commit.as_str(), motor.validation.plants), ("c0ffee", 1000));
}

#[test]
fn result_that_broke_a_limit_is_refused_with_motor_limit_and_seed() {
    let broken = r#"{"objective":"step","seed":524291,"what":"ERROR 12"},{"objective":"move","seed":524300,"what":"a false stall"}"#;
    for (text, what) in [
        (result(false, broken), "step on the plant of seed 524291: ERROR 12; 1 more"),
        (result(true, broken), "step on the plant of seed 524291: ERROR 12; 1 more"),
        (result(false, ""), "a plant of the search"),
    ] {
        let error = Tuned::of_result("DIR/tuned.json", &text).expect_err("not passed").to_string();
        assert!(error.contains("DIR/tuned.json: link did not pass") && error.contains(what), "{error}");
    }
}

#[test]
fn file_that_may_not_be_applied_is_refused_and_named() {
    let text = exported().text();
    for (from, to, what) in [
        ("\"format\": 1", "\"format\": 2", "another format"),
        ("\"format\": 1,", "", "not an export of it"),
        ("\"KP\": 150", "\"KPW\": 150", "did you mean KP?"),
        ("\"KP\": 150", "\"ID\": 3", "no property that shapes a motion"),
        ("\"KP\": 150", "\"KP\": 99999", "KP from 0 to 32767"),
        ("\"KP\": 150", "\"KP\": -1", "out of range"),
        ("\"KP\": 150", "\"KP\": 1.5", "tuned.json:"),
        ("\"passed\": true", "\"passed\": false", "did not pass its validation"),
        ("\"motor\": \"link\"", "\"motor\": \"lnik\"", "did you mean link?"),
        ("\"motor\": \"link\"", "\"motor\": \"arm\"", "no node has a motor of this kind"),
        ("\"plants\"", "\"plantz\"", "another form"),
    ] {
        assert!(text.contains(from), "{from}: {text}");
        let error = Tuned::parse("tuned.json", &text.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(error.starts_with("tuned.json") && error.contains(what), "{to}: {error}");
        assert!(error.contains("next:"), "{error}");
    }
    let mut twice = exported();
    twice.motors.push(twice.motors[0].clone());
    let error = Tuned::parse("tuned.json", &twice.text()).expect_err("two links").to_string();
    assert!(error.contains("link is there twice"), "{error}");
    let none = Tuned { motors: Vec::new(), ..exported() };
    assert!(Tuned::parse("tuned.json", &none.text()).expect_err("none").to_string().contains("no motor"));
}

#[test]
fn every_truncation_is_an_error() {
    let text = exported().text();
    for len in 0..text.trim_end().len() {
        let error = Tuned::parse("tuned.json", &text[..len]).expect_err("cut off").to_string();
        assert!(error.starts_with("tuned.json:"), "{len}: {error}");
    }
}
