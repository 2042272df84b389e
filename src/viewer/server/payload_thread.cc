#include <exception>
#include <utility>

#include "palpate/server/ordinary_thread.h"
#include "server/payload_store.h"

// The thread of a PayloadStore; a host without threads has another source for it (src/bindings/wasm).
namespace palpate::server {

PayloadStore::PayloadStore(Generator make) : make_(std::move(make)) {
  thread_ = std::thread([this] {
    use_ordinary_priority("viewer-volumes");
    work();
  });
}

PayloadStore::~PayloadStore() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  work_available_.notify_one();
  thread_.join();
}

void PayloadStore::run(std::function<void()> job) {
  {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(std::move(job));
  }
  work_available_.notify_one();
}

void PayloadStore::work() {
  while (true) {
    std::unique_lock lock(mutex_);
    work_available_.wait(lock, [this] { return stop_ || !jobs_.empty(); });
    if (stop_) return;
    const auto job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();

    // an exception from the callback is dropped; the connection that waits runs into its time limit
    try {
      job();
    } catch (const std::exception&) {
    }
  }
}

}  // namespace palpate::server
