//! A TCP proxy that can be cut silently: senders are not notified that their data is lost.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The proxy. Connections that were cut stay so; those made after it was restored work.
#[derive(Debug)]
pub struct Cable {
    port: u16,
    /// Even: connected. Connections made at a different count pass nothing on.
    state: Arc<AtomicU64>,
}

impl Cable {
    /// From a free port of this host to `port`.
    ///
    /// # Panics
    /// No port is free.
    pub fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port is free");
        let own = listener.local_addr().expect("it has an address").port();
        let state = Arc::new(AtomicU64::new(0));
        let now = Arc::clone(&state);
        std::thread::spawn(move || {
            for near in listener.incoming().flatten() {
                let Ok(far) = TcpStream::connect(("127.0.0.1", port)) else {
                    continue;
                };
                let made_at = now.load(Ordering::SeqCst);
                for (from, to) in [(&near, &far), (&far, &near)] {
                    let ends = from.try_clone().and_then(|from| Ok((from, to.try_clone()?)));
                    let (from, to) = ends.expect("a connection can be shared");
                    let now = Arc::clone(&now);
                    std::thread::spawn(move || pass_on(from, to, made_at, &now));
                }
            }
        });
        Self { port: own, state }
    }

    /// Port to connect to instead.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Cuts it: data sent from now on is lost, on new connections, too.
    pub fn cut(&self) {
        self.state.fetch_or(1, Ordering::SeqCst);
    }

    /// Restores it for new connections.
    pub fn mend(&self) {
        self.state.fetch_add(1, Ordering::SeqCst);
    }
}

fn pass_on(mut from: TcpStream, mut to: TcpStream, made_at: u64, now: &AtomicU64) {
    let mut buffer = vec![0; 1 << 16];
    loop {
        let Ok(count) = from.read(&mut buffer) else { return };
        while made_at % 2 == 1 || now.load(Ordering::SeqCst) != made_at {
            // Neither end receives anything more, not even that the other one is gone.
            std::thread::sleep(Duration::from_secs(1));
        }
        if count == 0 || to.write_all(&buffer[..count]).is_err() {
            // On error it is already closed.
            drop(to.shutdown(std::net::Shutdown::Both));
            return;
        }
    }
}
