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
  bool gzip = false;  ///< of labels alone

  auto operator<=>(const PayloadKey&) const = default;
};

/// The volumes of a session as bytes, each made once, when somebody first asks for it, by a thread that does
/// nothing else: a large one takes longer than viewers may wait for their next pose.
class PayloadStore {
 public:
  using Payload = std::shared_ptr<const std::string>;

  /// @param scan  may be null, and is then never wanted
  PayloadStore(std::shared_ptr<const Volume<float>> scan, const ScanScale& scale,
               std::shared_ptr<const Volume<LabelId>> labels, bool wide_labels);
  /// Ends at once; what is being made is thrown away, and nobody is told.
  ~PayloadStore();
  PayloadStore(const PayloadStore&) = delete;
  PayloadStore& operator=(const PayloadStore&) = delete;

  /// Hands over the bytes, or nothing where there was no memory for them, on the store's own thread.
  void want(const PayloadKey& key, std::function<void(Payload)> then);

 private:
  struct Wish {
    PayloadKey key;
    std::function<void(Payload)> then;
  };
  void work();
  Payload make(const PayloadKey& key) const;

  const std::shared_ptr<const Volume<float>> scan_;
  const ScanScale scale_;
  const std::shared_ptr<const Volume<LabelId>> labels_;
  const bool wide_labels_;
  // of the store's thread alone
  std::map<PayloadKey, Payload> made_;

  std::mutex mutex_;
  std::condition_variable wished_;
  std::deque<Wish> wishes_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace palpate::link
