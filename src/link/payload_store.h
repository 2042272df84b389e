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

#include "link/volume_payload.h"

namespace palpate::link {

struct PayloadKey {
  bool labels = false;
  int shrink = 1;
  bool gzip = false;    ///< of labels alone
  bool veiled = false;  ///< likewise: as learners see them while a quiz is at hand

  auto operator<=>(const PayloadKey&) const = default;
};

/// The volumes of a session as bytes, each made once, when somebody first asks for it, by a thread that does
/// nothing else: a large one takes longer than viewers may wait for their next pose.
class PayloadStore {
 public:
  using Payload = std::shared_ptr<const std::string>;
  /// Makes what a key names; nothing where `stop` became true in the meantime. May throw.
  using Maker = std::function<Payload(const PayloadKey& key, const std::atomic<bool>& stop)>;

  explicit PayloadStore(Maker make);
  /// Ends at once; what is being made is thrown away, and nobody is told.
  ~PayloadStore();
  PayloadStore(const PayloadStore&) = delete;
  PayloadStore& operator=(const PayloadStore&) = delete;

  /// Hands over the bytes on the store's own thread, or nothing where they could not be made (no memory): who
  /// asks again has them made again. `then` may throw, and is not called again.
  void want(const PayloadKey& key, std::function<void(Payload)> then);
  /// Has something else done on the store's thread that takes long. `job` may throw, as above.
  void run(std::function<void()> job);

 private:
  void work();
  Payload made(const PayloadKey& key);

  const Maker make_;
  // of the store's thread alone
  std::map<PayloadKey, Payload> made_;

  std::mutex mutex_;
  std::condition_variable wished_;
  std::deque<std::function<void()>> jobs_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Makes the volumes of a scene.
/// @param scan    may be null, and is then never wanted
/// @param veiled  labels as learners see them; null: they are never wanted
/// @param wide_labels, wide_veiled  needs_wide_labels() of each
PayloadStore::Maker volume_maker(std::shared_ptr<const Volume<float>> scan, const ScanScale& scale,
                                 std::shared_ptr<const Bricks<LabelId>> labels, bool wide_labels,
                                 std::shared_ptr<const Bricks<LabelId>> veiled = nullptr,
                                 bool wide_veiled = false);

}  // namespace palpate::link
