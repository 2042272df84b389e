#pragma once

#include <memory>
#include <variant>

#include "haply/connection.h"
#include "haply/haply_failures.h"
#include "haply/messages.h"

namespace palpate::haply {

/// A connection, and the service's version and inventory.
struct Found {
  ServiceVersion version;
  std::unique_ptr<Connection> connection;
  State inventory;
};

/// Reason of a failed search: kNoService, kOtherVersion, kSilent or kBroken.
struct NotFound {
  Failure why = Failure::kNoService;
  Error error;
};

/// Finds the service, connects to it and receives its inventory.
std::variant<Found, NotFound> connect_to_service(const HaplySettings& settings);

}  // namespace palpate::haply
