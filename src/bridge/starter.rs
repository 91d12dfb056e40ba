//! The thread that starts interpreters.
//!
//! Linux ends an interpreter with the *thread* that started it (`blend/start.py` asks for that). Work runs on threads that come and go, so
//! one thread, which lives as long as the program, starts them all.

use std::io::{Error, Result};
use std::process::{Child, Command};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, OnceLock, PoisonError};

struct Order {
    command: Command,
    answer: Sender<Result<Child>>,
}

/// Starts a command on the thread that lives as long as the program.
pub fn spawn(command: Command) -> Result<Child> {
    static ORDERS: OnceLock<Mutex<Option<Sender<Order>>>> = OnceLock::new();
    let orders = ORDERS.get_or_init(|| {
        let (sender, receiver) = channel::<Order>();
        let thread = std::thread::Builder::new().name("interpreters".into()).spawn(move || {
            for Order { mut command, answer } in receiver {
                // Who asked has gone: what was started is then dropped, and ends with its input.
                let _ = answer.send(command.spawn());
            }
        });
        Mutex::new(thread.is_ok().then_some(sender))
    });
    let (answer, started) = channel();
    let sender = orders.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let gone = || Error::other("no thread to start it");
    sender.ok_or_else(gone)?.send(Order { command, answer }).map_err(|_| gone())?;
    started.recv().map_err(|_| gone())?
}
