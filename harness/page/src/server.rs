//! The server of the page.

use std::convert::Infallible;
use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use hyper::body::{Body as _, Incoming};
use hyper::header::{self, HeaderMap, HeaderName, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc::Receiver;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::task::JoinHandle;

use crate::assets::{PAGE, asset};
use crate::body::Body;
use crate::guard::Sender;
use crate::token::Token;

/// So many connections at once: a browser has up to six for each page. (Ours.)
const CONNECTIONS: usize = 64;
/// The longest request that is asked, in bytes: a program of 128 MiB, each character of which may be written as two.
const ASKED_MAX: usize = 256 << 20;
/// The longest head of a request, in bytes. (Ours.)
const HEAD_MAX: usize = 16 << 10;
/// A head must have come within this. (Ours.)
const HEAD_WITHIN: Duration = Duration::from_secs(10);
/// A request must have come within this. (Ours.)
const ASKED_WITHIN: Duration = Duration::from_secs(30);
/// The kernel holds so many bytes for a browser that does not read, or twice as many: it would take megabytes, which
/// were old when they came. (Ours.)
const SENT: usize = 128 << 10;
/// Where no connection can be accepted, the next attempt is made so much later.
const AGAIN: Duration = Duration::from_millis(100);
/// The page is as it came, does not tell others its address, and loads nothing from elsewhere.
const ALWAYS: [(HeaderName, &str); 5] = [
    (header::CACHE_CONTROL, "no-store"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
];

/// What is behind the page.
pub trait Behind: Clone + Send + Sync + 'static {
    /// Answers what a browser asks.
    fn ask(&self, request: String) -> impl Future<Output = Answer> + Send;

    /// What a browser is told from now on, as events that the server sends; nothing more, once what this gives is
    /// dropped.
    fn tell(&self) -> Receiver<Bytes>;
}

/// What is answered.
#[derive(Debug)]
pub enum Answer {
    /// JSON.
    Json(String),
    /// A file to be kept.
    File {
        /// What a person would call it: letters, digits, `-`, `_` and `.`; what else is in it is left out.
        name: String,
        /// Its media type.
        media: &'static str,
        /// How many bytes there are.
        bytes: u64,
        /// They.
        pieces: Receiver<Bytes>,
    },
}

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The system refuses the address.
    #[error("no page can be served at {address}: {cause}; choose another address with --page=ADDRESS:PORT")]
    Address {
        /// The address that was asked for.
        address: SocketAddr,
        /// What the system said.
        cause: io::Error,
    },
    /// There is no token.
    #[error("the system gives no random numbers for the page's token")]
    Random(#[source] io::Error),
}

/// The server of a page. Dropped, it is gone.
#[derive(Debug)]
pub struct Server {
    url: String,
    accepting: JoinHandle<()>,
    /// Each connection has one.
    places: Arc<Semaphore>,
    closes: watch::Sender<bool>,
}

/// What every connection needs to know.
struct Shared<B> {
    address: SocketAddr,
    token: Token,
    behind: B,
    closes: watch::Receiver<bool>,
}

impl Server {
    /// Serves the page at an address; with port 0, at one that is free.
    ///
    /// # Errors
    /// [`PageError`]: what to do.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn open<B: Behind>(address: SocketAddr, behind: B) -> Result<Self, PageError> {
        let refused = |cause| PageError::Address { address, cause };
        let listener = std::net::TcpListener::bind(address).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        // Connections inherit it.
        rustix::net::sockopt::set_socket_send_buffer_size(&listener, SENT).map_err(|error| refused(error.into()))?;
        let listener = TcpListener::from_std(listener).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let token = Token::new().map_err(PageError::Random)?;
        let url = format!("http://{address}/{token}/");
        let places = Arc::new(Semaphore::new(CONNECTIONS));
        let closes = watch::Sender::new(false);
        let shared = Arc::new(Shared { address, token, behind, closes: closes.subscribe() });
        let accepting = tokio::spawn(accept(listener, shared, Arc::clone(&places)));
        Ok(Self { url, accepting, places, closes })
    }

    /// Serves nothing more, and waits until every browser has read what it was told before. What it is
    /// [told](Behind::tell) must have an end.
    pub async fn close(&self) {
        self.accepting.abort();
        self.closes.send_replace(true);
        self.places.acquire_many(CONNECTIONS as u32).await.ok();
    }

    /// The page's address, with its token.
    pub fn url(&self) -> &str {
        &self.url
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.accepting.abort();
    }
}

async fn accept<B: Behind>(listener: TcpListener, shared: Arc<Shared<B>>, places: Arc<Semaphore>) {
    loop {
        // It is never closed.
        let Ok(place) = Arc::clone(&places).acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, _)) => drop(tokio::spawn(serve(stream, Arc::clone(&shared), place))),
            Err(error) => {
                tracing::debug!(%error, "no new browser can be served for now");
                tokio::time::sleep(AGAIN).await;
            }
        }
    }
}

async fn serve<B: Behind>(stream: TcpStream, shared: Arc<Shared<B>>, place: OwnedSemaphorePermit) {
    let mut closes = shared.closes.clone();
    let service = service_fn(|request| {
        let shared = Arc::clone(&shared);
        async move { Ok::<_, Infallible>(shared.answer(request).await) }
    });
    // What is small is sent at once.
    stream.set_nodelay(true).ok();
    let mut server = http1::Builder::new();
    server.timer(TokioTimer::new()).header_read_timeout(HEAD_WITHIN).max_buf_size(HEAD_MAX);
    let closed = async move { drop(closes.wait_for(|closes| *closes).await) };
    let mut connection = pin!(server.serve_connection(TokioIo::new(stream), service));
    let served = tokio::select! {
        served = connection.as_mut() => served,
        () = closed => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = served {
        tracing::debug!(%error, "a browser is lost");
    }
    drop(place);
}

impl<B: Behind> Shared<B> {
    async fn answer(&self, request: Request<Incoming>) -> Response<Body> {
        let path = request.uri().path().to_owned();
        // Who does not know the token is not told what else is wrong.
        let Some(name) = self.below_token(&path) else {
            return text(StatusCode::FORBIDDEN, "expected the address that the rig has announced, with its token");
        };
        let changes = request.method() != Method::GET;
        if let Err(expected) = sender(request.headers()).check(self.address, changes) {
            return text(StatusCode::FORBIDDEN, expected);
        }
        match (request.method(), name) {
            (&Method::GET, "events") => answer(StatusCode::OK, "text/event-stream", Body::Coming(self.behind.tell())),
            (&Method::GET, name) => match asset(if name.is_empty() { PAGE } else { name }) {
                Some((kind, content)) => answer(StatusCode::OK, kind, Body::text(content)),
                None => text(StatusCode::NOT_FOUND, "the page has no such part"),
            },
            (&Method::POST, "ask") => self.ask(request).await,
            _ => text(StatusCode::METHOD_NOT_ALLOWED, "expected GET, or POST to 'ask'"),
        }
    }

    /// What of a path follows on the token; none, if that is another.
    fn below_token<'a>(&self, path: &'a str) -> Option<&'a str> {
        let (token, name) = path.strip_prefix('/')?.split_once('/')?;
        self.token.is(token).then_some(name)
    }

    async fn ask(&self, request: Request<Incoming>) -> Response<Body> {
        // A form of another site cannot say so.
        let json = HeaderValue::from_static("application/json");
        if request.headers().get(header::CONTENT_TYPE) != Some(&json) {
            return text(StatusCode::UNSUPPORTED_MEDIA_TYPE, "expected application/json");
        }
        match tokio::time::timeout(ASKED_WITHIN, whole(request.into_body())).await {
            Ok(Some(asked)) => match self.behind.ask(asked).await {
                Answer::Json(text) => answer(StatusCode::OK, "application/json", Body::text(text)),
                Answer::File { name, media, bytes, pieces } => file(&name, media, bytes, pieces),
            },
            Ok(None) => text(StatusCode::PAYLOAD_TOO_LARGE, "expected a request in UTF-8 of at most 256 MiB"),
            Err(_) => text(StatusCode::REQUEST_TIMEOUT, "expected the whole request sooner"),
        }
    }
}

fn sender(headers: &HeaderMap) -> Sender<'_> {
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let site = HeaderName::from_static("sec-fetch-site");
    Sender { host: text(header::HOST), origin: text(header::ORIGIN), site: text(site) }
}

/// A request's text; none, if it is too long, or no text, or breaks off.
async fn whole(mut body: Incoming) -> Option<String> {
    let mut asked = BytesMut::new();
    while let Some(frame) = std::future::poll_fn(|context: &mut Context<'_>| poll(&mut body, context)).await {
        let Ok(data) = frame.ok()?.into_data() else { continue };
        if asked.len() + data.len() > ASKED_MAX {
            return None;
        }
        asked.extend_from_slice(&data);
    }
    String::from_utf8(asked.to_vec()).ok()
}

fn poll(
    body: &mut Incoming,
    context: &mut Context<'_>,
) -> Poll<Option<Result<hyper::body::Frame<Bytes>, hyper::Error>>> {
    Pin::new(body).poll_frame(context)
}

fn text(status: StatusCode, text: &'static str) -> Response<Body> {
    answer(status, "text/plain; charset=utf-8", Body::text(text))
}

/// A file, which a browser is to keep and not to show.
fn file(name: &str, media: &'static str, bytes: u64, pieces: Receiver<Bytes>) -> Response<Body> {
    let mut response = answer(StatusCode::OK, media, Body::Coming(pieces));
    let is_plain = |c: &char| c.is_ascii_alphanumeric() || "-_.".contains(*c);
    let name: String = name.chars().filter(is_plain).collect();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(bytes));
    if let Ok(kept) = HeaderValue::from_str(&format!("attachment; filename=\"{name}\"")) {
        headers.insert(header::CONTENT_DISPOSITION, kept);
    }
    response
}

fn answer(status: StatusCode, kind: &'static str, body: Body) -> Response<Body> {
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    for (name, value) in ALWAYS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}
