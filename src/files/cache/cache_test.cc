#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "base/test_child.h"
#include "base/test_files.h"
#include "base/test_seed.h"
#include "palpate/cache/cache.h"
#include "palpate/cache/entries.h"
#include "palpate/cache/fields.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::vector<std::byte> bytes_of(const std::string& text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

cache::Digest key_of(int number) {
  cache::Key key("test", 1);
  key.put(number);
  return key.digest().value();
}

class CacheTest : public ::testing::Test {
 protected:
  CacheTest() { use(1 << 20); }
  ~CacheTest() override { set_cache({}); }

  void use(std::uint64_t max_bytes) {
    set_cache({stored_, max_bytes, [this](const std::string& text) { warnings_.push_back(text); }});
  }
  fs::path file_of(const cache::Digest& key) const { return stored_ / cache::name_of_entry(key); }
  // sets the time of last use
  void age(const cache::Digest& key, int hours) const {
    fs::last_write_time(file_of(key), fs::file_time_type::clock::now() - std::chrono::hours(hours));
  }

  test::TemporaryFolder folder_;
  const fs::path stored_ = folder_ / "home/cache/palpate";
  std::vector<std::string> warnings_;
};

std::optional<std::vector<std::byte>> found(const cache::Digest& key) {
  const auto payload = cache::find(key);
  if (!payload) return std::nullopt;
  return std::vector<std::byte>(payload->bytes().begin(), payload->bytes().end());
}

TEST_F(CacheTest, FindsStoredEntriesOnly) {
  EXPECT_FALSE(cache::find(key_of(1)));
  cache::store(key_of(1), bytes_of("one"));
  cache::store(key_of(2), bytes_of(""));
  EXPECT_EQ(found(key_of(1)), bytes_of("one"));
  EXPECT_EQ(found(key_of(2)), bytes_of(""));
  EXPECT_FALSE(cache::find(key_of(3)));
  cache::store(key_of(1), bytes_of("another"));
  EXPECT_EQ(found(key_of(1)), bytes_of("another"));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(CacheTest, IsReadableByTheOwnerOnly) {
  cache::store(key_of(1), bytes_of("one"));
  struct stat folder {
  }, file{};
  ASSERT_EQ(::stat(stored_.c_str(), &folder), 0);
  ASSERT_EQ(::stat(file_of(key_of(1)).c_str(), &file), 0);
  EXPECT_EQ(folder.st_mode & 0777u, 0700u);
  EXPECT_EQ(file.st_mode & 0777u, 0600u);
}

TEST_F(CacheTest, LeavesOnlyEntries) {
  for (int n = 0; n < 5; ++n) cache::store(key_of(n), bytes_of("payload"));
  EXPECT_EQ(std::distance(fs::directory_iterator(stored_), {}), 5);
}

TEST_F(CacheTest, StoresNothingWithoutAFolder) {
  set_cache({});
  EXPECT_FALSE(cache::is_cache_enabled());
  cache::store(key_of(1), bytes_of("one"));
  EXPECT_FALSE(cache::find(key_of(1)));
  EXPECT_FALSE(fs::exists(stored_));
}

TEST_F(CacheTest, EvictsLeastRecentlyUsedEntries) {
  const std::vector<std::byte> payload(1000);
  use(3500);
  for (int n = 0; n < 3; ++n) {
    cache::store(key_of(n), payload);
    age(key_of(n), 10 - n);
  }
  // 0 is the oldest, and is used now
  EXPECT_TRUE(cache::find(key_of(0)));
  cache::store(key_of(3), payload);
  EXPECT_TRUE(cache::find(key_of(0)));
  EXPECT_FALSE(cache::find(key_of(1)));
  EXPECT_TRUE(cache::find(key_of(2)));
  EXPECT_TRUE(cache::find(key_of(3)));
  EXPECT_LE(cache_contents().bytes, 3500u);
  EXPECT_EQ(cache_contents().max_bytes, 3500u);
}

TEST_F(CacheTest, EntriesAboveTheLimitAreNotStoredAndEvictNothing) {
  use(3500);
  cache::store(key_of(1), std::vector<std::byte>(1000));
  cache::store(key_of(2), std::vector<std::byte>(3500));
  EXPECT_TRUE(cache::find(key_of(1)));
  EXPECT_FALSE(cache::find(key_of(2)));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(CacheTest, IsBoundedByAFractionOfTheDisk) {
  use(std::numeric_limits<std::uint64_t>::max());
  cache::store(key_of(1), bytes_of("one"));
  const auto disk = fs::space(stored_);
  const double part = kMaxCacheDiskFraction * static_cast<double>(disk.capacity);
  EXPECT_LE(static_cast<double>(cache_contents().max_bytes), part);
}

TEST_F(CacheTest, IsEmptied) {
  cache::store(key_of(1), bytes_of("one"));
  cache::store(key_of(2), bytes_of("two"));
  test::write_text(stored_ / "mine.txt", "not the cache's");
  const auto removed = empty_cache();
  ASSERT_TRUE(removed.ok());
  EXPECT_EQ(removed->entries, 2u);
  EXPECT_EQ(cache_contents().entries, 0u);
  EXPECT_TRUE(fs::exists(stored_ / "mine.txt"));
}

TEST_F(CacheTest, RemovesFilesOfKilledProcesses) {
  cache::store(key_of(1), bytes_of("one"));
  const fs::path left = test::write_text(stored_ / ".palpate-0123456789abcdef-XyZ123.kept", "half");
  fs::last_write_time(left, fs::file_time_type::clock::now() - std::chrono::hours(2));
  const fs::path fresh = test::write_text(stored_ / ".palpate-0123456789abcdef-XyZ124.kept", "half");
  cache::store(key_of(2), bytes_of("two"));
  EXPECT_FALSE(fs::exists(left));
  // another process may be writing it
  EXPECT_TRUE(fs::exists(fresh));
  EXPECT_EQ(cache_contents().entries, 2u);
}

TEST_F(CacheTest, EveryDamageIsAnEntryThatIsNotThere) {
  const cache::Digest key = key_of(1);
  std::string text;
  for (int n = 0; n < 40; ++n) text += "payload " + std::to_string(n);
  cache::store(key, bytes_of(text));
  const std::string whole = test::bytes_of_file(file_of(key));
  ASSERT_TRUE(cache::find(key));
  // each byte flipped, and each length
  for (std::size_t n = 0; n < whole.size(); ++n) {
    std::string damaged = whole;
    damaged[n] = static_cast<char>(damaged[n] ^ (1 << (n % 8)));
    test::write_text(file_of(key), damaged);
    EXPECT_FALSE(cache::find(key)) << "byte " << n;
    test::write_text(file_of(key), whole.substr(0, n));
    EXPECT_FALSE(cache::find(key)) << n << " bytes";
  }
  test::write_text(file_of(key), whole + "x");
  EXPECT_FALSE(cache::find(key));
  // an entry under another key
  test::write_text(file_of(key_of(2)), whole);
  EXPECT_FALSE(cache::find(key_of(2)));
  // replaced
  cache::store(key, bytes_of(text));
  EXPECT_EQ(found(key), bytes_of(text));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(CacheTest, DoesNotBlockOnSpecialFiles) {
  cache::store(key_of(1), bytes_of("one"));
  fs::remove(file_of(key_of(1)));
  ASSERT_EQ(::mkfifo(file_of(key_of(1)).c_str(), 0600), 0);
  EXPECT_FALSE(cache::find(key_of(1)));
  fs::create_directory(file_of(key_of(2)));
  EXPECT_FALSE(cache::find(key_of(2)));
}

TEST_F(CacheTest, WarnsOnceOfWritableFolderAndDoesNotUseIt) {
  fs::create_directories(stored_);
  fs::permissions(stored_, fs::perms::all);
  cache::store(key_of(1), bytes_of("one"));
  cache::store(key_of(2), bytes_of("two"));
  EXPECT_EQ(cache_contents().entries, 0u);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("other accounts may write to it"), std::string::npos) << warnings_[0];
}

TEST_F(CacheTest, AnEntryThatOthersMayWriteToIsNotTaken) {
  cache::store(key_of(1), bytes_of("one"));
  fs::permissions(file_of(key_of(1)), fs::perms::others_write, fs::perm_options::add);
  EXPECT_FALSE(cache::find(key_of(1)));
  cache::store(key_of(1), bytes_of("one"));
  EXPECT_TRUE(cache::find(key_of(1)));
  if (::geteuid() != 0) return;
  // nor an entry of another account, which only root can create
  constexpr uid_t kNobody = 65534;
  ASSERT_EQ(::chown(file_of(key_of(1)).c_str(), kNobody, kNobody), 0);
  EXPECT_FALSE(cache::find(key_of(1)));
}

TEST_F(CacheTest, WarnsOnceIfTheFolderIsAFile) {
  test::write_text(folder_ / "home/cache/palpate", "a file");
  cache::store(key_of(1), bytes_of("one"));
  cache::store(key_of(2), bytes_of("two"));
  EXPECT_FALSE(cache::find(key_of(1)));
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(cache_contents().entries, 0u);
}

TEST_F(CacheTest, WarnsOnceOfFullDiskAndLeavesNoFile) {
  // the file size limit stands in for a full disk
  cache::store(key_of(1), bytes_of("one"));
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  rlimit before;
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{1000, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  cache::store(key_of(2), std::vector<std::byte>(5000));
  cache::store(key_of(3), std::vector<std::byte>(5000));
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, ignored);
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(std::distance(fs::directory_iterator(stored_), {}), 1);
}

TEST_F(CacheTest, TwoProcessesKeepTheSame) {
  // a concurrent reader finds nothing or one of the two, complete
  const std::string mine(20000, 'm'), others(20000, 'o');
  testing::Child child([&] {
    for (int n = 0; n < 200; ++n) cache::store(key_of(1), bytes_of(others));
  });
  int observed = 0;
  for (int n = 0; n < 200; ++n) {
    cache::store(key_of(1), bytes_of(mine));
    const auto stored = found(key_of(1));
    if (!stored) continue;
    ++observed;
    ASSERT_TRUE(*stored == bytes_of(mine) || *stored == bytes_of(others));
  }
  EXPECT_TRUE(child.finished());
  EXPECT_GT(observed, 0);
  EXPECT_TRUE(warnings_.empty());
  EXPECT_EQ(std::distance(fs::directory_iterator(stored_), {}), 1);
}

/// Environment variables that determine the cache folder, restored afterwards.
class CacheEnvironment : public ::testing::Test {
 protected:
  CacheEnvironment() {
    for (const char* name : kNames)
      before_.push_back(std::getenv(name) ? std::optional<std::string>(std::getenv(name)) : std::nullopt);
    for (const char* name : kNames) ::unsetenv(name);
    ::setenv("HOME", "/home/somebody", 1);
  }
  ~CacheEnvironment() override {
    for (std::size_t n = 0; n < before_.size(); ++n)
      before_[n] ? ::setenv(kNames[n], before_[n]->c_str(), 1) : ::unsetenv(kNames[n]);
  }
  static constexpr const char* kNames[] = {"PALPATE_CACHE", "PALPATE_CACHE_LIMIT", "XDG_CACHE_HOME", "HOME"};
  std::vector<std::optional<std::string>> before_;
};

TEST_F(CacheEnvironment, SetsTheFolder) {
  EXPECT_EQ(cache_settings_of_environment()->folder, "/home/somebody/.cache/palpate");
  ::setenv("XDG_CACHE_HOME", "relative", 1);
  EXPECT_EQ(cache_settings_of_environment()->folder, "/home/somebody/.cache/palpate");
  ::setenv("XDG_CACHE_HOME", "/xdg", 1);
  EXPECT_EQ(cache_settings_of_environment()->folder, "/xdg/palpate");
  ::setenv("PALPATE_CACHE", "/named", 1);
  EXPECT_EQ(cache_settings_of_environment()->folder, "/named");
  ::setenv("PALPATE_CACHE", "", 1);
  EXPECT_EQ(cache_settings_of_environment()->folder, "");
}

TEST_F(CacheEnvironment, SetsTheSizeLimit) {
  EXPECT_EQ(cache_settings_of_environment()->max_bytes, kDefaultCacheBytes);
  ::setenv("PALPATE_CACHE_LIMIT", "800M", 1);
  EXPECT_EQ(cache_settings_of_environment()->max_bytes, std::uint64_t{800} << 20);
  ::setenv("PALPATE_CACHE_LIMIT", "much", 1);
  const auto refused = cache_settings_of_environment();
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kUsage);
  EXPECT_EQ(refused.error().where, "PALPATE_CACHE_LIMIT");
}

TEST(CacheKeys, DifferWhereAnythingDiffers) {
  const auto key = [](std::string_view kind, std::uint32_t version, std::string_view text, double number) {
    cache::Key made(kind, version);
    made.put(text);
    made.put(number);
    return made.digest().value();
  };
  const cache::Digest one = key("a", 1, "bc", 2);
  EXPECT_EQ(one, key("a", 1, "bc", 2));
  EXPECT_NE(one, key("b", 1, "bc", 2));
  EXPECT_NE(one, key("a", 2, "bc", 2));
  EXPECT_NE(one, key("a", 1, "bd", 2));
  EXPECT_NE(one, key("ab", 1, "c", 2));
  EXPECT_NE(one, key("a", 1, "bc", -2));
}

TEST(CacheKeys, DigestsTellEveryByteAndTheSizeOfLargeThings) {
  // three whole pieces and a partial one
  std::vector<std::uint8_t> values((std::size_t{3} << 22) + 5, 7);
  const auto whole = cache::digest_of(values);
  for (const std::size_t index : {std::size_t{0}, (std::size_t{1} << 22) - 1, std::size_t{1} << 22,
                                  (std::size_t{2} << 22) + 3, values.size() - 1}) {
    values[index] = 8;
    EXPECT_NE(cache::digest_of(values), whole) << index;
    values[index] = 7;
  }
  EXPECT_EQ(cache::digest_of(values), whole);
  values.push_back(7);
  EXPECT_NE(cache::digest_of(values), whole);
}

TEST(CacheKeys, FileDigestStartsAtTheGivenOffset) {
  const test::TemporaryFolder folder;
  const auto digest = [&](const std::string& text, std::uint64_t from) {
    return cache::digest_of(*InputFile::open(test::write_text(folder / "file", text)), from).value();
  };
  const std::string voxels(600000, 'v');
  EXPECT_EQ(digest("head" + voxels, 4), digest("other head" + voxels, 10));
  EXPECT_NE(digest("head" + voxels, 4), digest("head" + voxels, 5));
  EXPECT_NE(digest(voxels, 0), digest(voxels + "v", 0));
}

template <class T>
void expect_same_back(const std::vector<T>& values) {
  cache::FieldWriter out;
  out.put(std::uint16_t{77});
  out.put_values(std::span<const T>(values));
  cache::FieldReader in(out.bytes());
  std::uint16_t before = 0;
  in.get(before);
  EXPECT_EQ(before, 77);
  std::vector<T> read(values.size());
  in.get_values(std::span<T>(read));
  EXPECT_TRUE(in.finished());
  EXPECT_TRUE(values.empty() || std::memcmp(read.data(), values.data(), values.size() * sizeof(T)) == 0);
}

// runs of all lengths, separated by different values
template <class T>
std::vector<T> patchy(std::mt19937& random, std::size_t size) {
  std::vector<T> values;
  while (values.size() < size) {
    const T value = static_cast<T>(random() % 100);
    const std::size_t length = random() % 3 == 0 ? random() % 200 : 1 + random() % 3;
    values.insert(values.end(), std::min(length, size - values.size()), value);
  }
  return values;
}

TEST(CacheFields, ValuesComeBackBitForBit) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  for (int n = 0; n < 200; ++n) {
    expect_same_back(patchy<std::uint8_t>(random, random() % 1000));
    expect_same_back(patchy<std::int16_t>(random, random() % 1000));
    expect_same_back(patchy<float>(random, random() % 1000));
  }
  expect_same_back(std::vector<float>{0.f, -0.f, std::numeric_limits<float>::quiet_NaN(),
                                      std::numeric_limits<float>::infinity()});
  expect_same_back(std::vector<std::uint16_t>(1 << 20, 0));
}

TEST(CacheFields, BackgroundTakesNoRoom) {
  const std::vector<std::uint16_t> values(1 << 20, 3);
  cache::FieldWriter out;
  out.put_values(std::span<const std::uint16_t>(values));
  EXPECT_LT(out.bytes().size(), 16u);
}

TEST(CacheFields, HostileBytesEndTheReadingAndWriteNowhereElse) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  int refused = 0;
  for (int n = 0; n < 5000; ++n) {
    const auto values = patchy<std::int16_t>(random, 300);
    cache::FieldWriter out;
    out.put_values(std::span<const std::int16_t>(values));
    std::vector<std::byte> bytes = out.bytes();
    for (auto flips = 1 + random() % 3; flips > 0; --flips)
      bytes[random() % bytes.size()] ^= static_cast<std::byte>(1u << random() % 8);
    if (random() % 2 == 0) bytes.resize(random() % bytes.size());
    cache::FieldReader in(bytes);
    // adjacent memory is checked by the sanitizers, and here
    std::vector<std::int16_t> read(302, -1);
    in.get_values(std::span(read).subspan(1, 300));
    EXPECT_EQ(read.front(), -1);
    EXPECT_EQ(read.back(), -1);
    refused += !in.finished();
  }
  EXPECT_GT(refused, 1000);
}

}  // namespace
}  // namespace palpate
