#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/volume_payload.h"

namespace palpate::server {

/// Identifies a volume payload: scan or labels, resolution and encoding.
struct PayloadKey {
  bool labels = false;
  int shrink = 1;
  bool gzip = false;      ///< Labels only
  bool redacted = false;  ///< Labels only: redacted, as learners see them during a quiz

  auto operator<=>(const PayloadKey&) const = default;
};

/// Volumes of a session in wire format. Each is generated once, on first request, on a dedicated thread,
/// because a large one takes longer than the period of poses.
class PayloadStore {
 public:
  using Payload = std::shared_ptr<const std::string>;
  /// Generates the payload for a key; null if `stop` became true in the meantime. May throw.
  using Generator = std::function<Payload(const PayloadKey& key, const std::atomic<bool>& stop)>;

  explicit PayloadStore(Generator make);
  /// Ends at once; unfinished work is discarded and callbacks are not called.
  ~PayloadStore();
  PayloadStore(const PayloadStore&) = delete;
  PayloadStore& operator=(const PayloadStore&) = delete;

  /// Passes the payload to `then` on the store's thread, or null if it could not be generated (out of
  /// memory), in which case the next request retries. `then` may throw; it is not called again.
  void request(const PayloadKey& key, std::function<void(Payload)> then);
  /// Runs another long job on the store's thread. `job` may throw, as above.
  void run(std::function<void()> job);

 private:
  void work();
  Payload payload_for(const PayloadKey& key);

  const Generator make_;
  // used by the store's thread only
  std::map<PayloadKey, Payload> made_;

  std::mutex mutex_;
  std::condition_variable work_available_;
  std::deque<std::function<void()>> jobs_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Returns the generator for the volumes of a scene.
/// @param scan          may be null if it is never requested
/// @param redacted      labels as learners see them; null if never requested
/// @param wide_labels,  wide_redacted  needs_wide_labels() of each
PayloadStore::Generator volume_generator(std::shared_ptr<const Volume<float>> scan, const ScanScale& scale,
                                         std::shared_ptr<const Bricks<LabelId>> labels, bool wide_labels,
                                         std::shared_ptr<const Bricks<LabelId>> redacted = nullptr,
                                         bool wide_redacted = false);

}  // namespace palpate::server
