#include "palpate/reader/reader_process.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "base/test_child.h"
#include "base/test_folder.h"
#include "base/test_limits.h"
#include "reader/test_leaks.h"

namespace palpate::reader {
namespace {

using Job = ReaderProcess::Job;
using Work = ReaderProcess::Work;
const Progress kSilent;

std::unique_ptr<ReaderProcess> start(const Work& work, Job job = {}, const Progress& progress = kSilent) {
  job.death_error = "it died";
  job.timeout_error = "it does not end";
  auto process = ReaderProcess::start(job, work, progress);
  PALPATE_CHECK(process.ok());
  return *std::move(process);
}

// number read from a process that runs `work`, or the error
std::string read_from(const Work& work, const Job& job = {}, const Progress& progress = kSilent) {
  const auto process = start(work, job, progress);
  std::uint64_t number = 0;
  const auto read = process->read(std::as_writable_bytes(std::span(&number, 1)));
  return read ? std::to_string(number) : read.error().what;
}

bool send(ParentEnd& parent, std::uint64_t number) {
  return parent.write(std::as_bytes(std::span(&number, 1)));
}

[[noreturn]] void loop() {
  for (volatile std::uint64_t n = 0;;) n = n + 1;
}

// nothing is left of a process, however it ended
class ReaderProcessTest : public ::testing::Test {
 protected:
  void SetUp() override { before_ = test::open_descriptors(); }
  void TearDown() override {
    EXPECT_EQ(test::open_descriptors(), before_);
    EXPECT_TRUE(test::has_no_child());
  }

 private:
  std::size_t before_ = 0;
};

TEST_F(ReaderProcessTest, DeliversSentBytes) {
  const auto process = start([](ParentEnd& parent) {
    const std::vector<std::byte> many(1 << 20, std::byte{7});
    return send(parent, 5) && parent.write(many);
  });
  std::uint64_t number = 0;
  ASSERT_TRUE(process->read(std::as_writable_bytes(std::span(&number, 1))));
  EXPECT_EQ(number, 5u);
  std::vector<std::byte> many(1 << 20);
  ASSERT_TRUE(process->read(many));
  EXPECT_EQ(many, std::vector<std::byte>(1 << 20, std::byte{7}));
  std::byte more{};
  const auto end = process->read({&more, 1});
  ASSERT_FALSE(end);
  EXPECT_EQ(end.error().what, "it died");
}

TEST_F(ReaderProcessTest, HoweverItDiesThereIsOneError) {
  for (const int signal : {SIGSEGV, SIGBUS, SIGABRT, SIGKILL, SIGTERM, SIGFPE})
    EXPECT_EQ(read_from([&](ParentEnd&) { return ::raise(signal) == 0; }), "it died") << signal;
  EXPECT_EQ(read_from([](ParentEnd&) { return false; }), "it died");
  EXPECT_EQ(read_from([](ParentEnd&) { return true; }), "it died") << "without a word";
  EXPECT_EQ(read_from([](ParentEnd&) -> bool { throw std::runtime_error("x"); }), "it died");
  // half a number
  EXPECT_EQ(read_from([](ParentEnd& parent) {
              const std::uint32_t half = 1;
              return parent.write(std::as_bytes(std::span(&half, 1)));
            }),
            "it died");
}

TEST_F(ReaderProcessTest, IsNotKilledByAProcessIdThatMayHaveBeenReused) {
  testing::Child child([] {
    ::signal(SIGCHLD, SIG_IGN);
    auto process = start([](ParentEnd&) -> bool { loop(); });
    if (test::die_of(SYS_kill)) process.reset();
  });
  EXPECT_TRUE(child.finished());
}

TEST_F(ReaderProcessTest, ReportsForkFailure) {
  // 0: the error was reported
  testing::Child child([] {
    if (!test::forbid_processes()) return;
    const auto process = ReaderProcess::start(
        {}, [](ParentEnd&) { return true; }, kSilent);
    const bool reported =
        !process.ok() && process.error().kind == ErrorKind::kUnavailable &&
        process.error().what.find("cannot start a process to read it") != std::string::npos &&
        process.error().remedy.find("ulimit -u") != std::string::npos;
    if (!reported) ::_exit(1);
  });
  EXPECT_TRUE(child.finished());
}

TEST_F(ReaderProcessTest, TimesOutASilentProcess) {
  Job impatient;
  impatient.timeout = std::chrono::milliseconds(200);
  EXPECT_EQ(read_from([](ParentEnd&) -> bool { loop(); }, impatient), "it does not end");
  EXPECT_EQ(read_from([](ParentEnd&) { return ::raise(SIGSTOP) == 0; }, impatient), "it does not end");
}

TEST_F(ReaderProcessTest, EachByteRenewsThePatience) {
  Job job;
  job.timeout = std::chrono::seconds(3);
  // eight bytes in 5 s
  EXPECT_EQ(read_from(
                [](ParentEnd& parent) {
                  const std::byte zero{};
                  for (int n = 0; n < 8; ++n) {
                    std::this_thread::sleep_for(std::chrono::milliseconds(600));
                    if (!parent.write({&zero, 1})) return false;
                  }
                  return true;
                },
                job),
            "0");
}

TEST_F(ReaderProcessTest, InterruptEndsALoop) {
  std::atomic<bool> stop = false;
  const Progress progress({}, &stop);
  std::thread user([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    stop = true;
  });
  // long before the patience of 20 s ends
  EXPECT_EQ(read_from([](ParentEnd&) -> bool { loop(); }, {}, progress), "interrupted");
  user.join();
}

TEST_F(ReaderProcessTest, TerminatesAFloodingProcess) {
  const Work flood = [](ParentEnd& parent) {
    const std::vector<std::byte> much(1 << 16, std::byte{1});
    while (parent.write(much)) {
    }
    return false;
  };
  EXPECT_EQ(read_from(flood), std::to_string(0x0101010101010101));
}

TEST_F(ReaderProcessTest, HundredsLeaveNothing) {
  const auto mappings = [] {
    std::ifstream maps("/proc/self/maps");
    return std::count(std::istreambuf_iterator<char>(maps), {}, '\n');
  };
  Job job;
  job.shared_bytes = 1 << 20;
  EXPECT_EQ(read_from([](ParentEnd& parent) { return send(parent, 1); }, job), "1");
  const auto before = mappings();
  for (std::uint64_t n = 0; n < 300; ++n)
    ASSERT_EQ(read_from([&](ParentEnd& parent) { return send(parent, n); }, job), std::to_string(n));
  EXPECT_LT(mappings() - before, 30);
}

TEST_F(ReaderProcessTest, SharedBytesGoToAndFroByWords) {
  Job job;
  job.shared_bytes = sizeof(std::uint64_t);
  const auto process = start(
      [](ParentEnd& parent) {
        for (std::uint64_t n = 1; n <= 100; ++n) {
          std::memcpy(parent.shared().data(), &n, sizeof n);
          const std::byte there{};
          // nothing is overwritten before the parent has allowed it
          if (!parent.write({&there, 1}) || !parent.wait_for_grant()) return false;
        }
        return true;
      },
      job);
  for (std::uint64_t n = 1; n <= 100; ++n) {
    std::byte there{};
    ASSERT_TRUE(process->read({&there, 1}));
    std::uint64_t number = 0;
    std::memcpy(&number, process->shared().data(), sizeof number);
    ASSERT_EQ(number, n);
    process->resume();
  }
}

TEST_F(ReaderProcessTest, AWordIsNeverWaitedFor) {
  // a process that fills its own counter
  const auto process = start([](ParentEnd& parent) {
    for (int descriptor = 3; descriptor < 100; ++descriptor) {
      const std::uint64_t largest = ~std::uint64_t{0} - 1;
      if (::write(descriptor, &largest, sizeof largest) != sizeof largest) continue;
      // the pipe received the same number
      if (!send(parent, 3)) return false;
    }
    loop();
  });
  std::uint64_t number = 0;
  while (number != 3) ASSERT_TRUE(process->read(std::as_writable_bytes(std::span(&number, 1))));
  process->resume();
  process->resume();
}

TEST_F(ReaderProcessTest, NoDescriptorButItsOwnIsInherited) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  std::ofstream(folder / "secret") << "y";
  // without O_CLOEXEC
  const int secret = ::open((folder / "secret").c_str(), O_RDONLY),
            file = ::open((folder / "file").c_str(), O_RDONLY);
  Job job;
  job.files = {&file, 1};
  EXPECT_EQ(read_from(
                [&](ParentEnd& parent) {
                  std::uint64_t open = 0;
                  for (int descriptor = 0; descriptor < 1000; ++descriptor)
                    open += ::fcntl(descriptor, F_GETFD) >= 0;
                  return ::fcntl(file, F_GETFD) >= 0 && ::fcntl(secret, F_GETFD) < 0 && send(parent, open);
                },
                job),
            "6")
      << "three of nothing, pipe, words, file";
  ::close(secret);
  ::close(file);
}

TEST_F(ReaderProcessTest, ItDoesNotOutliveTheProgram) {
  // orphans are reparented to this process
  ASSERT_EQ(::prctl(PR_SET_CHILD_SUBREAPER, 1), 0);
  pid_t reading = 0;
  {
    palpate::testing::Shared<std::atomic<pid_t>> started;
    const palpate::testing::Child program([&] {
      const auto process = start([](ParentEnd& parent) -> bool {
        send(parent, static_cast<std::uint64_t>(::getpid()));
        loop();
      });
      std::uint64_t id = 0;
      static_cast<void>(process->read(std::as_writable_bytes(std::span(&id, 1))));
      *started = static_cast<pid_t>(id);
      loop();
    });
    while (*started == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    reading = *started;
  }
  int status = 0;
  EXPECT_EQ(::waitpid(reading, &status, 0), reading);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(::prctl(PR_SET_CHILD_SUBREAPER, 0), 0);
}

}  // namespace
}  // namespace palpate::reader
