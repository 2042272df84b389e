#include "catalog/download.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/file.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <random>
#include <sstream>
#include <vector>

#include "base/test_folder.h"
#include "catalog/digest.h"
#include "catalog/test_server.h"
#include "catalog/transfer.h"

namespace palpate {
namespace {

using test::bytes_of_file;
using test::TemporaryFolder;
using test::write_text;
using testing::ElementsAre;
using testing::HasSubstr;

// server of a folder with one file of random bytes, and the parameters of its download
class DownloadTest : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(server_.running()) << "needs python3";
    std::mt19937 random(7);
    for (int i = 0; i < 300000; ++i) content_ += static_cast<char>(random());
    write_text(served_ / "file.bin", content_);
  }

  Download request(const std::string& behaviour) const {
    Download download;
    download.url = server_.url(behaviour) + "/file.bin";
    download.target = target_;
    download.bytes = content_.size();
    download.sha256 = *sha256_of_file(served_ / "file.bin");
    download.allow_http = true;
    download.first_pause_s = 0.01;
    return download;
  }
  Result<void> get(const std::string& behaviour) const { return download(request(behaviour), {}); }

  void expect_whole() const {
    EXPECT_TRUE(bytes_of_file(target_) == content_);
    EXPECT_FALSE(std::filesystem::exists(part_));
  }
  void expect_nothing() const {
    EXPECT_FALSE(std::filesystem::exists(target_));
    EXPECT_FALSE(std::filesystem::exists(part_));
  }
  void expect_unavailable(const Result<void>& done, const std::string& words) const {
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().kind, ErrorKind::kUnavailable);
    EXPECT_THAT(done.error().message(), HasSubstr(words));
    EXPECT_FALSE(std::filesystem::exists(target_));
  }
  // Range header of every request, "-" for none
  std::vector<std::string> ranges() const {
    std::string text;
    transfer(
        {server_.url("_requests"), true, 0, 5},
        [&](const TransferReply&, std::string_view bytes) { return text.append(bytes), true; },
        [] { return true; });
    std::vector<std::string> found;
    std::istringstream lines(text);
    for (std::string path, range; lines >> path >> range;) found.push_back(range);
    return found;
  }

  TemporaryFolder served_, into_;
  test::TestServer server_{served_.path()};
  std::string content_;
  const std::filesystem::path target_ = into_ / "file.bin", part_ = into_ / "file.bin.part";
};

TEST_F(DownloadTest, WholeFile) {
  double last = 0;
  std::string stage;
  const Progress progress(
      [&](std::string_view name, double fraction) {
        EXPECT_GE(fraction, last);
        last = fraction;
        stage = name;
      },
      nullptr);
  const auto done = download(request("ok"), progress);
  ASSERT_TRUE(done) << done.error().message();
  expect_whole();
  EXPECT_EQ(last, 1.0);
  EXPECT_EQ(stage, "fetching file.bin");
}

TEST_F(DownloadTest, SizeNotKnown) {
  auto unsized = request("ok");
  unsized.bytes.reset();
  unsized.git_blob = *git_blob_of_file(served_ / "file.bin");
  unsized.sha256.clear();
  ASSERT_TRUE(download(unsized, {}));
  expect_whole();
}

TEST_F(DownloadTest, CutConnectionsAreResumed) {
  const auto done = get("cut-100000");
  ASSERT_TRUE(done) << done.error().message();
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("-", "bytes=100000-", "bytes=200000-"));
}

TEST_F(DownloadTest, ShortAnswersWithoutLengthAreResumed) {
  ASSERT_TRUE(get("short-150000"));
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("-", "bytes=150000-"));
}

TEST_F(DownloadTest, BoundsAttemptsAndKeepsPartialDownload) {
  auto patient = request("cut-100");
  patient.attempts = 3;
  expect_unavailable(download(patient, {}), "the part received so far is kept");
  EXPECT_EQ(bytes_of_file(part_), content_.substr(0, 300));
  EXPECT_EQ(ranges().size(), 3u);
  // a later call resumes
  ASSERT_TRUE(get("ok"));
  expect_whole();
  EXPECT_EQ(ranges().back(), "bytes=300-");
}

TEST_F(DownloadTest, StallIsNoticedAndResumed) {
  auto impatient = request("stall-1000");
  impatient.stall_timeout_s = 3;
  const auto done = download(impatient, {});
  ASSERT_TRUE(done) << done.error().message();
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("-", "bytes=1000-"));
}

TEST_F(DownloadTest, SilenceEnds) {
  auto impatient = request("silent");
  impatient.attempts = 1;
  impatient.stall_timeout_s = 0.5;
  expect_unavailable(download(impatient, {}), "no more data arrived");
  expect_nothing();
}

TEST_F(DownloadTest, RestartsIfTheServerIgnoresRanges) {
  ASSERT_TRUE(get("norange-cut-120000"));
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("-", "bytes=120000-"));
}

TEST_F(DownloadTest, WrongRangeIsNotTaken) {
  write_text(part_, content_.substr(0, 5000));
  // "shifted" answers a request without a range correctly
  const auto done = get("shifted");
  ASSERT_TRUE(done) << done.error().message();
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("bytes=5000-", "-"));
}

TEST_F(DownloadTest, FileThatChangedSinceIsFetchedAgain) {
  write_text(part_, std::string(5000, 'x'));
  ASSERT_TRUE(get("ok"));
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("bytes=5000-", "-"));
}

TEST_F(DownloadTest, PartThatIsCompleteNeedsNoRequest) {
  write_text(part_, content_);
  ASSERT_TRUE(get("missing"));
  expect_whole();
  EXPECT_TRUE(ranges().empty());
}

TEST_F(DownloadTest, CompletePartOfUnknownSize) {
  write_text(part_, content_);
  auto unsized = request("ok");
  unsized.bytes.reset();
  ASSERT_TRUE(download(unsized, {}));
  expect_whole();
  // answered 416: there is nothing beyond
  EXPECT_THAT(ranges(), ElementsAre("bytes=300000-"));
}

TEST_F(DownloadTest, PartLongerThanTheFile) {
  write_text(part_, content_ + "more");
  auto unsized = request("ok");
  unsized.bytes.reset();
  ASSERT_TRUE(download(unsized, {}));
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("bytes=300004-", "-"));
}

TEST_F(DownloadTest, OtherContentIsDeleted) {
  const auto done = get("corrupt");
  expect_unavailable(done, request("ok").sha256);
  EXPECT_THAT(done.error().what, HasSubstr("SHA-256 is"));
  expect_nothing();
  EXPECT_EQ(ranges().size(), 1u);
}

TEST_F(DownloadTest, WrongGitBlob) {
  auto other = request("ok");
  other.git_blob = std::string(40, 'a');
  expect_unavailable(download(other, {}), std::string(40, 'a'));
  expect_nothing();
}

TEST_F(DownloadTest, BusyServerIsAskedAgain) {
  ASSERT_TRUE(get("unready-2"));
  expect_whole();
  EXPECT_EQ(ranges().size(), 3u);
}

TEST_F(DownloadTest, BusyServerForEver) {
  expect_unavailable(get("unready-99"), "503");
  expect_nothing();
  EXPECT_EQ(ranges().size(), 4u);
}

TEST_F(DownloadTest, MissingFileIsNotAskedForTwice) {
  expect_unavailable(get("missing"), "404");
  expect_nothing();
  EXPECT_EQ(ranges().size(), 1u);
}

TEST_F(DownloadTest, RedirectsAreFollowed) {
  ASSERT_TRUE(get("moved"));
  expect_whole();
}

TEST_F(DownloadTest, RedirectsWithoutEndAreRefused) {
  expect_unavailable(get("loop"), "redirects");
  expect_nothing();
}

TEST_F(DownloadTest, RedirectToAnotherProtocolIsRefused) {
  expect_unavailable(get("elsewhere"), "is not fetched");
  expect_nothing();
}

TEST_F(DownloadTest, PlainHttpIsRefusedUnlessAllowed) {
  auto strict = request("ok");
  strict.allow_http = false;
  expect_unavailable(download(strict, {}), "is not fetched");
  EXPECT_TRUE(ranges().empty());
}

TEST_F(DownloadTest, EndlessAnswerIsCutOff) {
  expect_unavailable(get("endless"), "larger");
  expect_nothing();
  auto unsized = request("endless");
  unsized.bytes.reset();
  unsized.max_bytes = 1000000;
  expect_unavailable(download(unsized, {}), "larger");
  expect_nothing();
}

TEST_F(DownloadTest, AnnouncedSizeBeyondTheLimit) {
  auto small = request("ok");
  small.bytes.reset();
  small.max_bytes = content_.size() - 1;
  expect_unavailable(download(small, {}), "larger");
  expect_nothing();
}

TEST_F(DownloadTest, InterruptedAndResumed) {
  std::atomic<bool> stop{false};
  const Progress progress(
      [&](std::string_view, double fraction) {
        if (fraction > 0.2) stop = true;
      },
      &stop);
  const auto done = download(request("stall-150000"), progress);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, ErrorKind::kInterrupted);
  EXPECT_FALSE(std::filesystem::exists(target_));
  EXPECT_FALSE(bytes_of_file(part_).empty());
  ASSERT_TRUE(get("ok"));
  expect_whole();
  EXPECT_THAT(ranges().back(), HasSubstr("bytes="));
}

TEST_F(DownloadTest, InterruptedWhileItWaits) {
  std::atomic<bool> stop{true};
  const auto done = download(request("unready-99"), Progress({}, &stop));
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, ErrorKind::kInterrupted);
  expect_nothing();
}

TEST_F(DownloadTest, FolderThatIsNotThere) {
  auto lost = request("ok");
  lost.target = into_ / "absent/file.bin";
  const auto done = download(lost, {});
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, ErrorKind::kOutput);
}

TEST_F(DownloadTest, DiskThatTakesNoMore) {
  // a file size limit makes a write fail as a full disk does
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{100000, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const auto done = get("ok");
  std::signal(SIGXFSZ, handler);
  ::setrlimit(RLIMIT_FSIZE, &before);

  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, ErrorKind::kOutput);
  EXPECT_FALSE(std::filesystem::exists(target_));
  EXPECT_EQ(bytes_of_file(part_), content_.substr(0, 100000));
  ASSERT_TRUE(get("ok"));
  expect_whole();
  EXPECT_THAT(ranges(), ElementsAre("-", "bytes=100000-"));
}

TEST_F(DownloadTest, SecondProcessIsRefused) {
  const int fd = ::open(part_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  ASSERT_EQ(::flock(fd, LOCK_EX), 0);
  expect_unavailable(get("ok"), "another program");
  EXPECT_TRUE(std::filesystem::exists(part_)) << "it belongs to the other one";
  ::close(fd);
}

TEST(Download, ConnectionRefused) {
  const TemporaryFolder folder;
  // bound but not listening: the connection is refused immediately
  Download request;
  request.url = "http://127.0.0.1:1/file.bin";
  request.target = folder / "file.bin";
  request.sha256 = std::string(64, '0');
  request.allow_http = true;
  request.attempts = 2;
  request.first_pause_s = 0.01;
  const auto done = download(request, {});
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, ErrorKind::kUnavailable);
  EXPECT_THAT(done.error().where, HasSubstr("127.0.0.1:1"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Download, ContentIsChecked) {
  const TemporaryFolder folder;
  write_text(folder / "abc", "abc");
  const std::string sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  const std::string blob = "f2ba8f84ab5c1bce84a7b441cb1959cfc7093b7f";
  EXPECT_TRUE(check_content(folder / "abc", 3, sha256, blob));
  EXPECT_TRUE(check_content(folder / "abc", {}, "", ""));
  const auto other = check_content(folder / "abc", 3, std::string(64, 'b'), "");
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().what, testing::AllOf(HasSubstr(sha256), HasSubstr(std::string(64, 'b'))));
  EXPECT_THAT(check_content(folder / "abc", 4, "", "").error().what, HasSubstr("3 bytes instead of 4"));
  EXPECT_FALSE(check_content(folder / "absent", {}, "", "").ok());
}

}  // namespace
}  // namespace palpate
