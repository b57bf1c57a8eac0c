#!/usr/bin/env bash
# A folder with a scenario that passes, one that fails, one that is inconclusive and one that is broken: what those who
# read JUnit in CI make of the report. Usage: tests/junit.sh TORNO
#   Jenkins  its strict schema, by xmllint
#   GitHub   junitparser, by which EnricoMi/publish-unit-test-result-action reads
#   GitLab   a plain reader of XML, for what GitLab looks at: names, classes, times, and what stands in a case
set -euo pipefail
torno=$(realpath "$1")
schema=$(realpath "$(dirname "$0")/junit-10.xsd")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
mkdir below
turn='[[step]]
does = "the carriage goes out"
send = ["00 64 03 84 00 00 00 00"]
[[step]]
does = "it is done"
wait = { reply = "XON", within = "TIME" }'
jam='[[fault]]
board = "depth"
kind = "stall"
when = { reply = "CAN" }'
printf 'name = "a turn"\n%s\n' "${turn/TIME/5 s}" >below/pass.toml
printf 'name = "a hasty turn"\n%s\n' "${turn/TIME/500 ms}" >below/fail.toml
printf 'name = "a jam"\n%s\n%s\n' "${turn/TIME/5 s}" "$jam" >below/inconclusive.toml
printf 'name = "a typo"\n[[stpe]]\n' >broken.toml

status=0
"$torno" test . --junit report.xml || status=$?
[ "$status" -eq 2 ] || { echo "status $status: expected 2"; exit 1; }
xmllint --noout --schema "$schema" report.xml
python3 - <<'EOF'
import xml.etree.ElementTree as tree

import junitparser

expected = {
    "a turn": ("below.pass", []),
    "a hasty turn": ("below.fail", ["failure"]),
    "a jam": ("below.inconclusive", ["skipped"]),
    "a typo": ("broken", ["error"]),
}
report = junitparser.JUnitXml.fromfile("report.xml")
counts = (report.tests, report.failures, report.errors)
assert counts == (4, 1, 1) and report.time > 0, (counts, report.time)
suites = list(report)
assert [suite.name for suite in suites] == [suite._elem.attrib["file"] for suite in suites]
assert sorted(suite.name for suite in suites)[0] == "below/fail.toml"
cases = [case for suite in suites for case in suite]
counts = [sum(getattr(suite, count) for suite in suites) for count in ("tests", "failures", "errors", "skipped")]
assert counts == [4, 1, 1, 1], counts
found = {case.name: (case.classname, [result._tag for result in case.result]) for case in cases}
assert found == expected, found
times = [report.time, sum(suite.time for suite in suites), sum(case.time for case in cases)]
assert max(times) - min(times) < 0.005, times

found = {}
for case in tree.parse("report.xml").getroot().iter("testcase"):
    float(case.attrib["time"])
    found[case.attrib["name"]] = (case.attrib["classname"], [result.tag for result in case])
    for result in case:
        assert result.attrib["message"] and result.text, case.attrib["name"]
assert found == expected, found
print("read by xmllint, junitparser and ElementTree: 1 passed, 1 failed, 1 inconclusive, 1 broken")
EOF
