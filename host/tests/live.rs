//! The server of the live view: what it sends, and to whom it refuses to.

use rugosa_host::view::live::{MOST_CLIENTS, Server};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

fn server() -> Server {
    Server::start("127.0.0.1:0".parse().unwrap()).unwrap()
}

/// Sends a request and gives the connection and what has come first.
fn ask(server: &Server, path: &str, headers: &str) -> (TcpStream, String) {
    let mut stream = TcpStream::connect(server.address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(10)))
        .unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\n{headers}\r\n").unwrap();
    let mut start = Vec::new();
    let mut piece = [0; 4096];
    while !start.windows(4).any(|w| w == b"\r\n\r\n") {
        let n = stream.read(&mut piece).unwrap();
        assert!(n > 0, "closed after {start:?}");
        start.extend(&piece[..n]);
    }
    (stream, String::from_utf8_lossy(&start).into_owned())
}

fn websocket(host: &str, origin: &str) -> String {
    format!(
        "Host: {host}\r\nOrigin: {origin}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    )
}

#[test]
fn a_browser_gets_the_page_and_the_last_state() {
    let server = server();
    let host = server.address.to_string();
    let (_, page) = ask(&server, "/", &format!("Host: {host}\r\n"));
    assert!(
        page.starts_with("HTTP/1.1 200") && page.contains("text/html"),
        "{page}"
    );
    server.publish("{\"first\":1}".into());
    server.publish("{\"second\":2}".into());
    let headers = websocket(&host, &format!("http://{host}"));
    let (mut stream, answer) = ask(&server, "/data", &headers);
    assert!(answer.starts_with("HTTP/1.1 101"), "{answer}");
    let mut got = answer.split_once("\r\n\r\n").unwrap().1.as_bytes().to_vec();
    let mut piece = [0; 64];
    while !String::from_utf8_lossy(&got).contains("{\"second\":2}") {
        let n = stream.read(&mut piece).unwrap();
        assert!(n > 0, "{got:?}");
        got.extend(&piece[..n]);
    }
    assert!(!String::from_utf8_lossy(&got).contains("first"));
}

#[test]
fn other_origins_and_names_are_refused() {
    let server = server();
    let host = server.address.to_string();
    let port = server.address.port();
    let own = format!("http://{host}");
    for (host, origin) in [
        (host.as_str(), "http://evil.example"),
        (&host, "null"),
        (&host, "http://127.0.0.1:1"),
        (
            &format!("evil.example:{port}"),
            &format!("http://evil.example:{port}"),
        ),
        ("evil.example", &own),
    ] {
        let (_, answer) = ask(&server, "/data", &websocket(host, origin));
        assert!(
            answer.starts_with("HTTP/1.1 403"),
            "{host} {origin}: {answer}"
        );
    }
    let headers = websocket(&host, "http://x").replace("Origin: http://x\r\n", "");
    assert!(
        ask(&server, "/data", &headers)
            .1
            .starts_with("HTTP/1.1 403")
    );
    let (_, page) = ask(&server, "/", "Host: evil.example\r\n");
    assert!(page.starts_with("HTTP/1.1 403"), "{page}");
}

#[test]
fn no_more_clients_than_stated() {
    let server = server();
    let host = server.address.to_string();
    let headers = websocket(&host, &format!("http://{host}"));
    let kept: Vec<_> = (0..MOST_CLIENTS)
        .map(|_| ask(&server, "/data", &headers))
        .collect();
    assert!(
        kept.iter()
            .all(|(_, answer)| answer.starts_with("HTTP/1.1 101"))
    );
    let (_, answer) = ask(&server, "/data", &headers);
    assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
    drop(kept);
    let again = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        ask(&server, "/data", &headers)
            .1
            .starts_with("HTTP/1.1 101")
    });
    assert!(again, "a place is free again once a client has left");
}
