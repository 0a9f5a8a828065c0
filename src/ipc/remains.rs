//! What a process that was killed at the wrong moment leaves of a service: the file that describes it, without the memory behind it. While
//! that file lies there nobody can open the service or make it anew, and iceoryx2 0.10 clears it away only sometimes.

use std::fs;
use std::path::Path;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeState, Service, ServiceName};
use iceoryx2::service::messaging_pattern::MessagingPattern;
use iceoryx2::service::service_hash::ServiceHash;

/// Removes the description of a service that no living process holds or is making; whether there was one.
pub(super) fn remove<S: Service>(config: &Config, name: &ServiceName, pattern: MessagingPattern) -> bool {
    let global = &config.global;
    let hash = ServiceHash::new::<S::ServiceNameHasher>(name, pattern);
    let file = |suffix: String| format!("{}{hash}{suffix}", global.prefix);
    // A process that holds a service, or is at making it, says so in the folder of its node.
    let tag = file(global.node.service_tag_suffix.to_string());
    let nodes = global.node_dir().to_string();
    let mut is_held = false;
    let listed = Node::<S>::list(config, |state| {
        if let NodeState::Alive(node) = state {
            is_held |= Path::new(&nodes).join(node.id().value().to_string()).join(&tag).exists();
        }
        CallbackProgression::Continue
    });
    let description = Path::new(&global.service_dir().to_string())
        .join(file(global.service.static_config_storage_suffix.to_string()));
    let removed = listed.is_ok() && !is_held && fs::remove_file(&description).is_ok();
    if removed {
        tracing::warn!(service = name.as_str(), "removed what a killed process had left of a service");
    }
    removed
}
