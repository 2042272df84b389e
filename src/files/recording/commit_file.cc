#include "recording/commit_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace palpate::internal {
namespace {

class FileSink : public ByteSink {
 public:
  FileSink(int descriptor, OutputClaim claim) : claim_(std::move(claim)), descriptor_(descriptor) {}
  FileSink(const FileSink&) = delete;
  FileSink& operator=(const FileSink&) = delete;
  ~FileSink() override { ::close(descriptor_); }

  int write_at(std::uint64_t offset, std::span<const std::byte> bytes) override {
    while (!bytes.empty()) {
      const ssize_t wrote = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote <= 0) return wrote < 0 ? errno : ENOSPC;
      bytes = bytes.subspan(static_cast<std::size_t>(wrote));
      offset += static_cast<std::uint64_t>(wrote);
    }
    return 0;
  }

  int read_at(std::uint64_t offset, std::span<std::byte> bytes) override {
    while (!bytes.empty()) {
      const ssize_t received = ::pread(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
      if (received < 0 && errno == EINTR) continue;
      if (received < 0) return errno;
      if (received == 0) break;
      bytes = bytes.subspan(static_cast<std::size_t>(received));
      offset += static_cast<std::uint64_t>(received);
    }
    std::ranges::fill(bytes, std::byte{0});
    return 0;
  }

  int resize(std::uint64_t size) override {
    return ::ftruncate(descriptor_, static_cast<off_t>(size)) == 0 ? 0 : errno;
  }
  int sync() override { return ::fsync(descriptor_) == 0 ? 0 : errno; }

 private:
  OutputClaim claim_;
  int descriptor_;
};

// step of commit() to which a deferred write belongs
int step_of(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (offset == 0) return 1;
  return bytes.size() >= 4 && std::memcmp(bytes.data(), "OHDR", 4) == 0 ? 3 : 2;
}

}  // namespace

std::unique_ptr<ByteSink> make_file_sink(int descriptor, OutputClaim claim) {
  return std::make_unique<FileSink>(descriptor, std::move(claim));
}

void CommitFile::fail(int error) {
  if (error_ == 0) error_ = error;
  sealed_ = true;
}

void CommitFile::write(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (sealed_) return;
  // the part before the committed end is deferred, the rest is written immediately
  const std::uint64_t before_end = offset < committed_end_ ? committed_end_ - offset : 0;
  const std::size_t deferred_bytes =
      static_cast<std::size_t>(std::min<std::uint64_t>(before_end, bytes.size()));
  if (deferred_bytes > 0) defer(offset, bytes.first(deferred_bytes));
  if (deferred_bytes < bytes.size()) write_now(offset + deferred_bytes, bytes.subspan(deferred_bytes));
}

void CommitFile::write_now(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (const int error = sink_->write_at(offset, bytes)) return fail(error);
  written_end_ = std::max(written_end_, offset + bytes.size());
}

void CommitFile::defer(std::uint64_t offset, std::span<const std::byte> bytes) {
  // a block written again replaces its earlier version
  std::erase_if(pending_, [&](const PendingWrite& pending) {
    return pending.offset == offset && pending.bytes.size() == bytes.size();
  });
  pending_.push_back({offset, {bytes.begin(), bytes.end()}});
}

bool CommitFile::read(std::uint64_t offset, std::span<std::byte> bytes) const {
  if (sink_->read_at(offset, bytes) != 0) return false;
  // deferred writes overlay the file; later ones overlay earlier ones
  for (const PendingWrite& pending : pending_) {
    const std::uint64_t begin = std::max(offset, pending.offset);
    const std::uint64_t end = std::min(offset + bytes.size(), pending.offset + pending.bytes.size());
    if (begin < end)
      std::memcpy(bytes.data() + (begin - offset), pending.bytes.data() + (begin - pending.offset),
                  end - begin);
  }
  return true;
}

bool CommitFile::commit() {
  if (sealed_) return error_ == 0;
  // space that HDF5 allocated but did not write must exist before the superblock counts it
  if (written_end_ < end_) {
    if (const int error = sink_->resize(end_)) {
      fail(error);
      return false;
    }
    written_end_ = end_;
  }
  // from the first of the following writes on the file may refer to the new bytes
  committed_end_ = end_;
  std::ranges::stable_sort(
      pending_, {}, [](const PendingWrite& pending) { return step_of(pending.offset, pending.bytes); });
  for (const PendingWrite& pending : pending_) {
    write_now(pending.offset, pending.bytes);
    if (sealed_) return false;
  }
  pending_.clear();
  return true;
}

void CommitFile::trim_and_sync() {
  int error = sink_->resize(committed_end_);
  if (error == 0) error = sink_->sync();
  if (error != 0) fail(error);
}

}  // namespace palpate::internal
