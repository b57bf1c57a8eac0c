//! What a client has written, in order with the speeds that it sets and with what it flushes.

use super::*;

/// Everything that happens at once, without the client's first words and what it has set.
async fn all_that_follows(bench: &mut Bench, last: u8) -> Vec<PortEvent> {
    let mut all: Vec<PortEvent> = Vec::new();
    loop {
        let event = bench.event().await;
        let ends = matches!(&event, PortEvent::Data { bytes, .. } if bytes.ends_with(&[last]));
        all.push(event);
        if ends {
            return all;
        }
    }
}

#[tokio::test]
async fn bytes_are_of_the_speed_at_which_they_were_written() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    let speed = |baud| client.set(|termios| termios.set_speed(baud).unwrap());
    let written = |bytes: &[u8], baud| PortEvent::Data { bytes: bytes.to_vec(), coding: LineCoding::at(baud) };
    for round in 0..200_u32 {
        let (old, new) = (9_600 + round, 19_200 + round);
        speed(old);
        eventually(|| bench.port.unattended().pty.line().coding.baud == old).await;
        client.write(b"old").unwrap();
        // Returns at once, here.
        termios::tcdrain(&client.0).unwrap();
        speed(new);
        eventually(|| bench.port.unattended().pty.line().coding.baud == new).await;
        client.write(b"new!").unwrap();
        assert_eq!(all_that_follows(&mut bench, b'!').await, [written(b"old", old), written(b"new!", new)], "{round}");
    }
}

#[tokio::test]
async fn all_that_waits_is_of_the_old_speed_even_if_the_port_is_late() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    // More than the port takes before it is wanted.
    client.write(&[b'o'; 4_300]).unwrap();
    bench.arrived(4_300).await;
    unnoticed(&bench.port, || client.set(|termios| termios.set_speed(19_200).unwrap()));
    let old = all_data(&mut bench, 4_300).await;
    assert_eq!(old, [(RIG_BAUD, 4_300)]);
    unnoticed(&bench.port, || {
        client.set(|termios| termios.set_speed(38_400).unwrap());
        client.write(b"new").unwrap();
    });
    assert_eq!(all_data(&mut bench, 3).await, [(38_400, 3)]);
}

/// So many bytes: the speeds that they were written at, and how many at each.
async fn all_data(bench: &mut Bench, length: usize) -> Vec<(u32, usize)> {
    let mut all: Vec<(u32, usize)> = Vec::new();
    while all.iter().map(|(_, length)| length).sum::<usize>() < length {
        let PortEvent::Data { bytes, coding: LineCoding { baud, .. } } = bench.event().await else { panic!("no data") };
        match all.last_mut() {
            Some((last, length)) if *last == baud => *length += bytes.len(),
            _ => all.push((baud, bytes.len())),
        }
    }
    all
}

#[tokio::test]
async fn flush_right_after_a_write_drops_it_and_spares_what_follows() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    for round in 0..200 {
        client.write(b"old").unwrap();
        if round % 2 == 0 {
            // The kernel has handed them over to the master side: it does not flush them itself.
            bench.arrived(3).await;
        }
        termios::tcflush(&client.0, QueueSelector::OFlush).unwrap();
        assert_eq!(within(until_flushed(&mut bench)).await, PortEvent::Flushed);
        assert!(bench.is_quiet(4096), "{round}: old bytes survived the flush");
        unnoticed(&bench.port, || {
            termios::tcflush(&client.0, QueueSelector::OFlush).unwrap();
            client.write(b"new!").unwrap();
        });
        assert_eq!(all_that_follows(&mut bench, b'!').await, [PortEvent::Flushed, data(b"new!")], "{round}");
    }
}

#[tokio::test]
async fn flush_that_the_port_is_late_for_drops_what_was_written_before() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    for round in 0..200 {
        unnoticed(&bench.port, || {
            client.write(b"old").unwrap();
            // Elapsed time: the kernel hands the bytes over meanwhile.
            std::thread::sleep(Duration::from_micros(10 * round));
            termios::tcflush(&client.0, QueueSelector::OFlush).unwrap();
        });
        assert_eq!(bench.event().await, PortEvent::Flushed);
        assert!(bench.is_quiet(4096), "{round}: old bytes survived the flush");
    }
}

/// The next flush: what was written before may have been taken already.
async fn until_flushed(bench: &mut Bench) -> PortEvent {
    loop {
        match bench.port.event(0, None).await.unwrap() {
            PortEvent::Began | PortEvent::Set => {}
            event => return event,
        }
    }
}
