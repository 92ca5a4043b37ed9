//! One process's connection to a domain.

use std::cell::Cell;
use std::time::Duration;

use evac_frames::{Layout, layout_hash};
use iceoryx2::node::{Node, NodeBuilder, NodeWaitFailure};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::event::PortFactory as EventFactory;

use crate::services::Qos;
use crate::{Domain, PortError};

pub(crate) type Ipc = ipc::Service;

/// Attribute of every data service: name and hash of the layouts it carries.
const LAYOUT: &str = "layout";

/// Creation races with the clean-up of dead processes for a moment; longer than this it is a fault.
const OPEN_ATTEMPTS: u32 = 40;
const OPEN_PAUSE: Duration = Duration::from_millis(25);

/// One process's connection to a domain.
#[derive(Debug)]
pub struct Bus {
    pub(crate) node: Node<Ipc>,
    /// Whether the listeners that it opens are woken after those of others.
    pub(crate) wakes_last: bool,
    stop: Cell<bool>,
}

impl Bus {
    /// Joins the domain. From now on SIGINT and SIGTERM are seen by [`Self::stop_requested`] instead of ending the process.
    ///
    /// # Errors
    /// [`PortError`] where the domain's folder cannot be used or belongs to another user.
    pub fn join(domain: &Domain, name: &str) -> Result<Self, PortError> {
        domain.create_folder()?;
        let bad = |cause: String| PortError::BadDomain { name: domain.name().to_owned(), cause };
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(domain.prefix().as_bytes()).map_err(|e| bad(format!("prefix: {e:?}")))?;
        let folder = domain.folder();
        let root =
            Path::new(folder.as_os_str().as_encoded_bytes()).map_err(|e| bad(format!("folder: {e:?}")))?;
        config.global.set_root_path(&root);
        let node_name = NodeName::new(name).map_err(|e| bad(format!("stage name '{name}': {e:?}")))?;
        let node = NodeBuilder::new()
            .config(&config)
            .name(&node_name)
            .signal_handling_mode(SignalHandlingMode::HandleTerminationRequests)
            .create::<Ipc>()
            .map_err(|cause| PortError::refused("(node)", "join the domain", cause))?;
        domain.close_to_others();
        Ok(Self { node, wakes_last: false, stop: Cell::new(false) })
    }

    /// For a process that no other waits for: where several readers listen to a service, the listeners that this bus opens from now on are
    /// woken after all others. With fewer cores than readers that decides who runs first.
    pub fn wake_last(mut self) -> Self {
        self.wakes_last = true;
        self
    }

    /// Whether SIGINT or SIGTERM has come. It takes no system call, some 60 ns.
    pub fn stop_requested(&self) -> bool {
        // An interrupt is any signal, that of a process which was stopped and goes on included.
        if !self.stop.get()
            && matches!(self.node.wait(Duration::ZERO), Err(NodeWaitFailure::TerminationRequest))
        {
            self.stop.set(true);
        }
        self.stop.get()
    }

    /// Frees what dead processes of the domain left; returns how many were found.
    pub fn clean_up_dead(&self) -> u64 {
        self.node.try_cleanup_dead_nodes().cleanups
    }

    /// The event service that wakes a data service's readers.
    pub(crate) fn events(&self, service: &'static str, qos: &Qos) -> Result<EventFactory<Ipc>, PortError> {
        let name = service_name(service)?;
        retry(service, "open its events", || {
            self.node
                .service_builder(&name)
                .event()
                .max_notifiers(qos.publishers)
                .max_listeners(qos.subscribers)
                .max_nodes(qos.nodes)
                .open_or_create()
        })
    }
}

pub(crate) fn service_name(service: &'static str) -> Result<ServiceName, PortError> {
    ServiceName::new(service).map_err(|cause| PortError::refused(service, "be named", cause))
}

/// What a service of header `H` and element `T` says about its layouts.
pub(crate) fn layout_text<H: Layout, T: Layout>() -> String {
    format!("{}#{:016x}+{}#{:016x}", H::NAME, layout_hash::<H>(), T::NAME, layout_hash::<T>())
}

pub(crate) fn layout_attribute(
    service: &'static str,
    text: &str,
) -> Result<(AttributeVerifier, iceoryx2::service::attribute::AttributeKey), PortError> {
    let refused = |cause: String| PortError::refused(service, "describe its layout", cause);
    let key = LAYOUT.try_into().map_err(|e| refused(format!("{e:?}")))?;
    let value = text.try_into().map_err(|e| refused(format!("{e:?}")))?;
    let verifier = AttributeVerifier::new().require(&key, &value).map_err(|e| refused(format!("{e:?}")))?;
    Ok((verifier, key))
}

/// Repeats an opening that failed because another process creates or removes the service at this moment.
pub(crate) fn retry<T, E: std::fmt::Debug>(
    service: &'static str,
    action: &'static str,
    mut open: impl FnMut() -> Result<T, E>,
) -> Result<T, PortError> {
    let mut attempt = 0;
    loop {
        match open() {
            Ok(port) => return Ok(port),
            Err(cause) if attempt < OPEN_ATTEMPTS && is_passing(&format!("{cause:?}")) => {
                attempt += 1;
                std::thread::sleep(OPEN_PAUSE);
            }
            Err(cause) => return Err(PortError::refused(service, action, cause)),
        }
    }
}

fn is_passing(cause: &str) -> bool {
    [
        "MarkedForDestruction",
        "CorruptedState",
        "HangsInCreation",
        "ExceedsMax",
        "AlreadyExists",
        "SystemInFlux",
        "BeingCreated",
    ]
    .iter()
    .any(|word| cause.contains(word))
}

impl Bus {
    /// Explains why a service that exists could not be opened: if its layouts differ from ours, by both names.
    pub(crate) fn explain(&self, service: &'static str, ours: &str, refusal: PortError) -> PortError {
        let mut theirs = None;
        let listed = Ipc::list(self.node.config(), |details| {
            let details = details.static_details;
            if details.name().as_str() == service
                && let Ok(key) = LAYOUT.try_into()
                && let Some(value) = details.attributes().key_value(&key, 0)
            {
                theirs = Some(value.to_string());
                return CallbackProgression::Stop;
            }
            CallbackProgression::Continue
        });
        match theirs {
            Some(theirs) if listed.is_ok() && theirs != ours => {
                PortError::LayoutMismatch { service, ours: ours.to_owned(), theirs }
            }
            _ => refusal,
        }
    }
}
