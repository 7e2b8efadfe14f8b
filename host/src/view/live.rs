//! The server of the live view: the page, and its data over a WebSocket.
//!
//! It only ever sends. What a client says is not listened to, so nobody can control
//! anything. Pages of other origins get nothing: a WebSocket whose `Origin` is not the
//! server's own, and any request whose `Host` is neither an IP address nor `localhost`
//! (names can be made to point anywhere), is refused. At most [`MOST_CLIENTS`] clients
//! are served at a time; slow ones miss states, not the last one.

use super::page;
use crate::error::{Failure, Result};
use axum::Router;
use axum::extract::State;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket, WebSocketUpgrade};
use axum::http::header::{CACHE_CONTROL, HOST, ORIGIN};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use tokio::sync::{Semaphore, watch};

/// Where it listens unless told otherwise: this machine only.
pub const LOOPBACK: &str = "127.0.0.1:8645";
/// Clients that are served at a time.
pub const MOST_CLIENTS: usize = 8;
/// Longest message of a client; longer ones end its connection.
const MOST_BYTES: usize = 1024;

/// A running server; it ends with the process or when dropped.
pub struct Server {
    /// where it listens
    pub address: SocketAddr,
    state: watch::Sender<Utf8Bytes>,
    _runtime: tokio::runtime::Runtime,
}

#[derive(Clone)]
struct Shared {
    state: watch::Receiver<Utf8Bytes>,
    clients: Arc<Semaphore>,
}

impl Server {
    /// Listens at `address`; port 0 picks a free one.
    pub fn start(address: SocketAddr) -> Result<Self> {
        let failed = |e: std::io::Error| Failure::runtime(format_args!("{address}: {e}"));
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .map_err(failed)?;
        let listener = runtime
            .block_on(tokio::net::TcpListener::bind(address))
            .map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let (state, receiver) = watch::channel(Utf8Bytes::default());
        let shared = Shared {
            state: receiver,
            clients: Arc::new(Semaphore::new(MOST_CLIENTS)),
        };
        let app = Router::new()
            .route("/", get(index))
            .route("/data", get(data))
            .with_state(shared);
        runtime.spawn(async move { axum::serve(listener, app).await });
        Ok(Server {
            address,
            state,
            _runtime: runtime,
        })
    }

    /// Sends a state (JSON) to all clients, now and those to come.
    pub fn publish(&self, json: String) {
        self.state.send_replace(json.into());
    }
}

async fn index(headers: HeaderMap) -> Response {
    match own_host(&headers) {
        Some(_) => ([(CACHE_CONTROL, "no-store")], Html(page("null"))).into_response(),
        None => refusal(StatusCode::FORBIDDEN, "unknown host"),
    }
}

async fn data(
    headers: HeaderMap,
    State(shared): State<Shared>,
    socket: WebSocketUpgrade,
) -> Response {
    if !is_same_origin(&headers) {
        return refusal(StatusCode::FORBIDDEN, "other origins get nothing");
    }
    let Ok(permit) = shared.clients.clone().try_acquire_owned() else {
        return refusal(StatusCode::SERVICE_UNAVAILABLE, "too many clients");
    };
    socket
        .max_message_size(MOST_BYTES)
        .max_frame_size(MOST_BYTES)
        .on_upgrade(async move |socket| {
            send(socket, shared.state).await;
            drop(permit);
        })
}

fn refusal(code: StatusCode, why: &'static str) -> Response {
    (code, why).into_response()
}

/// Sends every state until the client goes away.
async fn send(mut socket: WebSocket, mut state: watch::Receiver<Utf8Bytes>) {
    state.mark_changed();
    loop {
        tokio::select! {
            changed = state.changed() => {
                let json = state.borrow_and_update().clone();
                if changed.is_err() {
                    return;
                }
                if !json.is_empty() && socket.send(Message::Text(json)).await.is_err() {
                    return;
                }
            }
            said = socket.recv() => {
                if !matches!(said, Some(Ok(_))) {
                    return;
                }
            }
        }
    }
}

/// The host that the client asked for, if it is one that cannot be somebody else's name.
fn own_host(headers: &HeaderMap) -> Option<&str> {
    let host = headers.get(HOST)?.to_str().ok()?;
    let is_address = host.parse::<SocketAddr>().is_ok() || host.parse::<IpAddr>().is_ok();
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    (is_address || name == "localhost").then_some(host)
}

/// Browsers always say where a page that opens a WebSocket comes from.
fn is_same_origin(headers: &HeaderMap) -> bool {
    let origin = headers.get(ORIGIN).and_then(|o| o.to_str().ok());
    let host = own_host(headers);
    host.is_some() && origin.and_then(|o| o.strip_prefix("http://")) == host
}
