//! Results as JUnit XML: what Jenkins' strict schema (`junit-10.xsd` of its xUnit plugin) allows, and no more.

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use super::{Attempt, Tested, Verdict};

/// The results as a report.
///
/// # Errors
/// If a name cannot be written as XML.
pub(super) fn junit(attempts: &[Attempt]) -> Result<String, quick_junit::SerializeError> {
    let mut suite = TestSuite::new("torno");
    for attempt in attempts {
        suite.add_test_case(case(attempt));
    }
    // As in the suite's own attribute: however many ran at once, the sum of its cases.
    let time = suite.test_cases.iter().filter_map(|case| case.time).sum();
    suite.set_time(time);
    let mut report = Report::new("torno test");
    report.set_time(time).add_test_suite(suite);
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
    case.set_classname(attempt.path()).set_time(attempt.wall());
    case
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
