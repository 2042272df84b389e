#include "haply/service_search.h"

#include "palpate/base/clock.h"

namespace palpate::haply {
namespace {

constexpr auto kInventoryPatience_ns = std::int64_t{2'000'000'000};

}  // namespace

std::variant<Found, NotFound> connect_to_service(const HaplySettings& settings) {
  const auto version = find_service(settings);
  if (!version) return NotFound{Failure::kNoService, version.error()};
  if (!force_key(*version)) {
    Error other = error_for(Failure::kOtherVersion, "haply");
    other.what += ": " + std::to_string(version->major) + "." + std::to_string(version->minor);
    return NotFound{Failure::kOtherVersion, other};
  }
  auto connection = Connection::open(settings, settings.port);
  if (!connection) return NotFound{Failure::kNoService, connection.error()};
  std::string text;
  const auto received = (*connection)->receive(text, monotonic_ns() + kInventoryPatience_ns);
  if (received != Connection::Received::kMessage)
    return NotFound{Failure::kSilent, error_for(Failure::kSilent, "haply")};
  auto inventory = parse_state(text);
  if (!inventory) return NotFound{Failure::kBroken, error_for(Failure::kBroken, "haply")};
  return Found{*version, *std::move(connection), *std::move(inventory)};
}

}  // namespace palpate::haply
