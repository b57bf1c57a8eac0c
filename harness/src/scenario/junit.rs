//! Results as JUnit XML: what Jenkins' strict schema (`junit-10.xsd` of its xUnit plugin) allows, and no more.

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use super::{Attempt, Tested, Verdict};

/// The results as a report.
///
/// # Errors
/// If a name cannot be written as XML.
pub(super) fn junit(attempts: &[Attempt]) -> Result<String, quick_junit::SerializeError> {
    let mut report = Report::new("torno test");
    // However many ran at once: the sum of its cases, as of a suite.
    report.set_time(attempts.iter().map(Attempt::wall).sum());
    for attempt in attempts {
        // The schema lets a suite name its file, and a case not. So each file is a suite.
        let file = attempt.path().strip_prefix("./").unwrap_or(attempt.path());
        let mut suite = TestSuite::new(file);
        suite.extra.insert("file".into(), file.into());
        suite.set_time(attempt.wall()).add_test_case(case(attempt));
        report.add_test_suite(suite);
    }
    // The schema knows this attribute of a suite, not of all suites together. The crate writes it of both.
    let skipped = format!(" skipped=\"{}\"", report.skipped);
    Ok(report.to_string()?.replacen(&skipped, "", 1))
}

fn case(attempt: &Attempt) -> TestCase {
    let status = match attempt {
        Attempt::Tested(tested) => status(tested),
        Attempt::Broken(broken) => {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
            status.set_message(broken.message.lines().next().unwrap_or_default()).set_description(&broken.message);
            status
        }
    };
    let mut case = TestCase::new(attempt.name(), status);
    case.set_classname(class(attempt.path())).set_time(attempt.wall());
    case
}

/// A file as the name of a class: readers take what stands before the last dot for packages, `below/a.toml` for one
/// with the name `toml`.
fn class(path: &str) -> String {
    let path = path.strip_suffix(".toml").unwrap_or(path);
    let parts = path.split('/').filter(|part| !["", ".", ".."].contains(part));
    parts.collect::<Vec<_>>().join(".")
}

fn status(tested: &Tested) -> TestCaseStatus {
    let verdict = tested.outcome.verdict();
    let mut status = match verdict {
        Verdict::Passed => return TestCaseStatus::success(),
        Verdict::Failed => TestCaseStatus::non_success(NonSuccessKind::Failure),
        Verdict::Inconclusive => TestCaseStatus::skipped(),
    };
    if let Some(first) = tested.outcome.first_failure() {
        let word = if verdict == Verdict::Inconclusive { "inconclusive: " } else { "" };
        status.set_message(format!("{word}expected {}, came {}", first.expected, first.came));
    }
    let text: Vec<String> = tested.outcome.failures.iter().map(ToString::to_string).collect();
    status.set_description(format!("{}\n  again     {}", text.join("\n"), tested.again()));
    status
}
