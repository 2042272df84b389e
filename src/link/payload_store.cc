#include "link/payload_store.h"

#include <new>
#include <utility>

#include "link/ordinary_thread.h"
#include "palpate/check.h"

namespace palpate::link {

PayloadStore::PayloadStore(std::shared_ptr<const Volume<float>> scan, const ScanScale& scale,
                           std::shared_ptr<const Volume<LabelId>> labels, bool wide_labels)
    : scan_(std::move(scan)), scale_(scale), labels_(std::move(labels)), wide_labels_(wide_labels) {
  PALPATE_CHECK(labels_);
  thread_ = std::thread([this] {
    be_ordinary_thread("viewer-volumes");
    work();
  });
}

PayloadStore::~PayloadStore() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wished_.notify_one();
  thread_.join();
}

void PayloadStore::want(const PayloadKey& key, std::function<void(Payload)> then) {
  {
    const std::lock_guard lock(mutex_);
    wishes_.push_back({key, std::move(then)});
  }
  wished_.notify_one();
}

void PayloadStore::work() {
  while (true) {
    std::unique_lock lock(mutex_);
    wished_.wait(lock, [this] { return stop_ || !wishes_.empty(); });
    if (stop_) return;
    const Wish wish = std::move(wishes_.front());
    wishes_.pop_front();
    lock.unlock();

    Payload& payload = made_[wish.key];
    if (!payload) payload = make(wish.key);
    if (!stop_) wish.then(payload);
  }
}

PayloadStore::Payload PayloadStore::make(const PayloadKey& key) const {
  try {
    if (!key.labels) return scan_ ? scan_payload(*scan_, scale_, key.shrink, stop_) : nullptr;
    const Payload plain = labels_payload(*labels_, wide_labels_, key.shrink, stop_);
    return plain && key.gzip ? gzip(*plain, stop_) : plain;
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}

}  // namespace palpate::link
