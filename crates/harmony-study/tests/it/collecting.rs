//! Answers that came as files.

use harmony_study::collect::{Export, collect};
use harmony_study::log::{Entry, Log, LogLimits, Via, read};

use crate::fixture::{answer, study};

#[test]
fn files_are_taken_once_and_only_with_an_invitation() {
    let study = study(3, 2, |_| {});
    let secret = study.secret();
    let log = Log::open(&study.log(), secret, LogLimits::default()).unwrap();
    let export = Export {
        format: 1,
        study: secret.study.clone(),
        version: secret.version.clone(),
        participant: "anna-0001".to_owned(),
        key: Some(secret.invitation("anna-0001")),
        finished: true,
        answers: (0..2).map(|t| answer(secret, "anna-0001", t, vec![3, 1, 2])).collect(),
    };
    let path = study.folder.path().join("anna.json");
    let write = |export: &Export| harmony_io::write_json(&path, export).unwrap();
    write(&export);
    let first = collect(&path, secret, &log, false).unwrap();
    assert_eq!((first.stored, first.before, first.refused.len()), (2, 0, 0));
    let again = collect(&path, secret, &log, false).unwrap();
    assert_eq!((again.stored, again.before, again.refused.len()), (0, 2, 0));
    // Somebody else's key, no key, somebody else's answers inside.
    let mut forged = export.clone();
    forged.participant = "bert-0001".to_owned();
    write(&forged);
    assert!(collect(&path, secret, &log, false).unwrap_err().to_string().contains("invitation"));
    forged.key = None;
    write(&forged);
    assert!(collect(&path, secret, &log, false).unwrap_err().to_string().contains("--unsigned"));
    forged.key = Some(secret.invitation("bert-0001"));
    forged.finished = false;
    write(&forged);
    let taken = collect(&path, secret, &log, false).unwrap();
    assert_eq!((taken.stored, taken.refused.len()), (0, 2));
    // Unsigned ones are marked.
    forged.key = None;
    forged.answers = vec![answer(secret, "bert-0001", 0, vec![1, 2, 3])];
    write(&forged);
    assert_eq!(collect(&path, secret, &log, true).unwrap().stored, 1);
    // Another study, another format, no JSON.
    let mut other = export.clone();
    other.version = "0".to_owned();
    write(&other);
    assert!(collect(&path, secret, &log, true).is_err());
    std::fs::write(&path, "{\"format\": 1").unwrap();
    assert!(collect(&path, secret, &log, true).unwrap_err().to_string().contains("anna.json"));
    log.close();
    let entries = read(&study.log(), secret).unwrap();
    let unsigned = entries.iter().filter(|e| matches!(e, Entry::Answer { via: Via::UnsignedFile, .. })).count();
    assert_eq!((entries.len(), unsigned), (1 + 2 + 1 + 1, 1));
}
