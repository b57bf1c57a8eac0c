//! Clients that come and go as fast as they can, while the port looks on.

use super::*;

/// So many clients in a row.
const CLIENTS: u32 = 3000;

/// Each opens the port, waits for a line and closes it. Some then come at once, and some while the port makes sure that
/// no one is there.
const SCRIPT: &str = r#"
n=0
while [ $n -lt $1 ]; do
  exec 3<>"$0"; read -r line <&3; exec 3>&-
  n=$((n + 1)); wait=$((n % 37))
  while [ $wait -gt 0 ]; do wait=$((wait - 1)); done
done"#;

/// A sender restarts its controller by opening the port: an opening that is missed is an answer that never comes.
#[test]
fn every_client_of_many_is_told_that_come_right_after_one_another() {
    // In a process of its own: where other tests start processes, these have copies of the port until they run.
    let alone = "linux::tests::clients::clients_that_come_right_after_one_another";
    let output = Command::new(std::env::current_exe().unwrap()).args(["--exact", alone, "--ignored"]).output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && told.contains("1 passed"), "{told}{}", String::from_utf8_lossy(&output.stderr));
}

#[tokio::test]
#[ignore = "run by the one above"]
async fn clients_that_come_right_after_one_another() {
    let mut bench = Bench::new();
    let mut clients = tokio::process::Command::new("sh");
    let clients = clients.args(["-c", SCRIPT]).arg(bench.port.path()).arg(CLIENTS.to_string());
    let mut clients = clients.kill_on_drop(true).spawn().unwrap();
    for n in 0..CLIENTS {
        assert_eq!(bench.event().await, PortEvent::Opened, "client {n}");
        bench.reply(b"\n");
        assert_eq!(bench.event().await, PortEvent::Closed, "client {n}");
    }
    assert!(within(clients.wait()).await.unwrap().success());
}
