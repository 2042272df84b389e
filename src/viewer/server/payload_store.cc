#include "server/payload_store.h"

#include <exception>
#include <utility>

#include "palpate/base/check.h"

namespace palpate::server {

void PayloadStore::request(const PayloadKey& key, std::function<void(Payload)> then) {
  run([this, key, then = std::move(then)] {
    const Payload payload = payload_for(key);
    if (!stop_) then(payload);
  });
}

// a failure affects this request only
PayloadStore::Payload PayloadStore::payload_for(const PayloadKey& key) try {
  Payload& payload = made_[key];
  if (!payload) payload = make_(key, stop_);
  return payload;
} catch (const std::exception&) {
  return nullptr;
}

PayloadStore::Generator volume_generator(std::shared_ptr<const Volume<float>> scan, const ScanScale& scale,
                                         std::shared_ptr<const Bricks<LabelId>> labels, bool wide_labels,
                                         std::shared_ptr<const Bricks<LabelId>> redacted,
                                         bool wide_redacted) {
  PALPATE_CHECK(labels);
  return
      [scan = std::move(scan), scale, labels = std::move(labels), wide_labels, redacted = std::move(redacted),
       wide_redacted](const PayloadKey& key, const std::atomic<bool>& stop) -> PayloadStore::Payload {
        if (!key.labels) return scan ? scan_payload(*scan, scale, key.shrink, stop) : nullptr;
        const PayloadStore::Payload plain = key.redacted
                                                ? labels_payload(*redacted, wide_redacted, key.shrink, stop)
                                                : labels_payload(*labels, wide_labels, key.shrink, stop);
        return plain && key.gzip ? gzip(*plain, stop) : plain;
      };
}

}  // namespace palpate::server
