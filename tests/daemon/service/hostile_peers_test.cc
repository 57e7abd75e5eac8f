// Peers that mean harm, or do it: bytes that are no call, connections without end, streams that
// nobody reads, callers who are thrown out while they watch. Nothing crashes and nothing turns on.

#include <arpa/inet.h>
#include <openssl/ssl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

#include <random>

#include "tests/daemon/service/laboratory.h"
#include "tests/daemon/service/service_fixture.h"
#include "tests/fixtures/damaged_text.h"
#include "tests/fixtures/dial.h"

namespace mesorig::daemon {
namespace {

using grpc::StatusCode;

// A connection that speaks bytes. -1: none.
int ConnectTcp(const std::string& address) {
  const size_t colon = address.rfind(':');
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<uint16_t>(std::stoi(address.substr(colon + 1))));
  ::inet_pton(AF_INET, address.substr(0, colon).c_str(), &to.sin_addr);
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
  return fd;
}

void SendAndLeave(int fd, const std::string& bytes) {
  (void)::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  ::close(fd);
}

// Whether the other end closes within 20 s (its handshake may take 5).
bool Closed(int fd) {
  const timeval limit{20, 0};
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  char buffer[4096];
  ssize_t n = 0;
  while ((n = ::read(fd, buffer, sizeof(buffer))) > 0) {
  }
  return n == 0 || errno == ECONNRESET;
}

std::string ClientHello() {
  SSL_CTX* context = SSL_CTX_new(TLS_client_method());
  SSL* ssl = SSL_new(context);
  BIO* out = BIO_new(BIO_s_mem());
  SSL_set_bio(ssl, BIO_new(BIO_s_mem()), out);
  SSL_connect(ssl);
  char* data = nullptr;
  const long size = BIO_get_mem_data(out, &data);
  std::string hello(data, static_cast<size_t>(size));
  SSL_free(ssl);
  SSL_CTX_free(context);
  return hello;
}

std::string Frame(char type, char flags, char stream, const std::string& payload) {
  std::string frame = {0,
                       static_cast<char>(payload.size() >> 8),
                       static_cast<char>(payload.size()),
                       type,
                       flags,
                       0,
                       0,
                       0,
                       stream};
  return frame + payload;
}

// A whole call as HTTP/2, its headers as literals.
std::string CallAsBytes(const std::string& path) {
  const auto literal = [](const std::string& name, const std::string& value) {
    return std::string(1, '\0') + static_cast<char>(name.size()) + name +
           static_cast<char>(value.size()) + value;
  };
  const std::string headers =
      std::string("\x83\x86") + literal(":path", path) + literal(":authority", "localhost") +
      literal("content-type", "application/grpc") + literal("te", "trailers");
  return "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + Frame(4, 0, 0, "") + Frame(1, 4, 1, headers) +
         Frame(0, 1, 1, std::string(5, '\0'));
}

// The real services, with both kinds of doors.
class HostilePeersTest : public ServiceTest {
 protected:
  void SetUp() override {
    const AccessOptions doors = lab_.Options();
    access_options_.listen = doors.listen;
    access_options_.tls_dir = doors.tls_dir;
    ServiceTest::SetUp();
  }
  void ExpectUnharmed() {
    grpc::ClientContext context;
    v1::StatusReply reply;
    const grpc::Status status = control_->GetStatus(&context, v1::StatusRequest(), &reply);
    EXPECT_TRUE(status.ok()) << status.error_message();
    EXPECT_TRUE(sequencer_.commands().empty()) << sequencer_.commands().front();
    EXPECT_EQ(sequencer_.session(), nullptr);
  }
  std::filesystem::path Socket(const std::string& role) const {
    return folder_.path() / "run" / fmt::format("mesorigd.{}.sock", role);
  }
  // Calls of the administrator that wait for events, each in its handler.
  void WatchOften(int calls) {
    sequencer_.Emit({});
    v1::Event event;
    for (int i = 0; i < calls; ++i) {
      contexts_.push_back(std::make_unique<grpc::ClientContext>());
      streams_.push_back(control_->Watch(contexts_.back().get(), v1::WatchRequest()));
      ASSERT_TRUE(streams_.back()->Read(&event));
    }
  }
  void EndWatching() {
    for (size_t i = 0; i < streams_.size(); ++i) {
      contexts_[i]->TryCancel();
      streams_[i]->Finish();
    }
  }
  Laboratory lab_;
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts_;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::Event>>> streams_;
};

TEST_F(HostilePeersTest, NonsenseInsteadOfTlsHarmsNothing) {
  const std::string hello = ClientHello();
  ASSERT_GT(hello.size(), 100u);
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    SendAndLeave(ConnectTcp(access_->address()),
                 i % 10 == 0 ? hello.substr(0, random() % hello.size())
                             : test::Damaged(hello, random, 1 + i % 8, std::string(4, '\xff')));
  }
  SendAndLeave(ConnectTcp(access_->address()), CallAsBytes("/mesorig.v1.Control/Abort"));
  SendAndLeave(ConnectTcp(access_->address()), std::string(100'000, '\0'));
  ExpectUnharmed();
}

TEST_F(HostilePeersTest, NonsenseInsteadOfHttpHarmsNothing) {
  // What is damaged here would be let in whole, elsewhere.
  const std::string call = CallAsBytes("/mesorig.v1.Control/Abort");
  const int fd = test::DialUnix(Socket("administrator"));
  ASSERT_EQ(::send(fd, call.data(), call.size(), MSG_NOSIGNAL), static_cast<ssize_t>(call.size()));
  while (sequencer_.commands().empty()) std::this_thread::yield();
  ::close(fd);
  EXPECT_EQ(sequencer_.commands().size(), 1u);
  std::mt19937 random(2);
  for (int i = 0; i < 400; ++i) {
    SendAndLeave(test::DialUnix(Socket("observer")),
                 i % 10 == 0
                     ? call.substr(0, random() % call.size())
                     : test::Damaged(call, random, 1 + i % 8, std::string("\x01\x04\xff", 3)));
  }
  EXPECT_EQ(sequencer_.commands().size(), 1u);
  grpc::ClientContext context;
  v1::StatusReply reply;
  EXPECT_TRUE(control_->GetStatus(&context, v1::StatusRequest(), &reply).ok());
}

TEST_F(HostilePeersTest, AStreamEndsWhenItsCallerIsRevoked) {
  const wire::KeyAndCertificate anna = lab_.Make("observer", "anna");
  const auto stub = v1::Control::NewStub(Dial(access_->address(), lab_.ca.certificate_pem, &anna));
  grpc::ClientContext context;
  const auto stream = stub->Watch(&context, v1::WatchRequest());
  sequencer_.Emit({});
  v1::Event event;
  ASSERT_TRUE(stream->Read(&event));
  lab_.Revoke(anna);
  while (stream->Read(&event)) {
  }
  EXPECT_EQ(stream->Finish().error_code(), StatusCode::CANCELLED);
  ExpectUnharmed();
}

// Another user of this machine: only this thread becomes him.
class OtherUserTest : public HostilePeersTest {
 protected:
  static constexpr uid_t kNobody = 65534;
  void SetUp() override {
    if (::geteuid() != 0) GTEST_SKIP() << "only root can become somebody else";
    access_options_.groups[Role::kOperator] = wire::GroupNamed("nogroup").ok() ? "nogroup" : "root";
    HostilePeersTest::SetUp();
    ::chmod(folder_.path().c_str(), 0711);
    ::chmod((folder_.path() / "run").c_str(), 0711);
  }
  // Sends a call as nobody; false when the kernel does not even let him connect.
  bool CallAsNobody(const std::filesystem::path& socket, std::string& reply) {
    bool connected = false;
    std::thread([&] {
      ::syscall(SYS_setgroups, 0, nullptr);
      ::syscall(SYS_setresgid, kNobody, kNobody, kNobody);
      ::syscall(SYS_setresuid, kNobody, kNobody, kNobody);
      sockaddr_un to{};
      to.sun_family = AF_UNIX;
      std::strncpy(to.sun_path, socket.c_str(), sizeof(to.sun_path) - 1);
      const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
      connected = ::connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) == 0;
      const std::string call = CallAsBytes("/mesorig.v1.Control/Abort");
      if (connected) (void)::send(fd, call.data(), call.size(), MSG_NOSIGNAL);
      // Until the other end closes, or has answered and done it.
      char buffer[4096];
      while (connected && (reply.empty() || sequencer_.commands().empty())) {
        const ssize_t n = ::recv(fd, buffer, sizeof(buffer), MSG_DONTWAIT);
        if (n == 0 || (n < 0 && errno != EAGAIN)) break;
        if (n > 0) reply.append(buffer, static_cast<size_t>(n));
        std::this_thread::yield();
      }
      ::close(fd);
    }).join();
    return connected;
  }
};

TEST_F(OtherUserTest, ComesInByHisGroupOnly) {
  std::string reply;
  EXPECT_FALSE(CallAsNobody(Socket("administrator"), reply)) << "the file's mode";
  // Somebody widened it: the daemon looks at the uid itself.
  ::chmod(Socket("administrator").c_str(), 0666);
  EXPECT_TRUE(CallAsNobody(Socket("administrator"), reply));
  EXPECT_EQ(reply, "") << "not a byte";
  EXPECT_TRUE(sequencer_.commands().empty());
  EXPECT_TRUE(CallAsNobody(Socket("operator"), reply));
  EXPECT_NE(reply, "");
  EXPECT_EQ(sequencer_.commands().size(), 1u) << "of the group of operators";
}

// There is no pool that could be used up: a call gets a thread however many others wait in theirs.
TEST_F(HostilePeersTest, AStopComesThroughBesideAHundredCallsThatWait) {
  ASSERT_NO_FATAL_FAILURE(WatchOften(100));
  const wire::KeyAndCertificate otto = lab_.Make("observer", "otto");
  const AnyReply stopped = AnyCall(Dial(access_->address(), lab_.ca.certificate_pem, &otto),
                                   "/mesorig.v1.Control/Stop");
  EXPECT_TRUE(stopped.status.ok()) << stopped.status.error_message();
  EXPECT_EQ(sequencer_.stopped().size(), 1u);
  EXPECT_EQ(access_->calls_under_way(), streams_.size());
  EndWatching();
}

class LimitsTest : public HostilePeersTest {
 protected:
  LimitsTest() {
    access_options_.handshake = std::chrono::milliseconds(200);
    access_options_.limits.connections_from_one = 4;
    access_options_.calls.calls_of_one = 3;
    access_options_.calls.stall = std::chrono::milliseconds(100);
    access_options_.calls.look = std::chrono::milliseconds(10);
  }
};

TEST_F(LimitsTest, WhoSaysNothingIsCutOff) {
  EXPECT_TRUE(Closed(ConnectTcp(access_->address())));
  EXPECT_TRUE(Closed(test::DialUnix(Socket("observer"))));
  ExpectUnharmed();
}

TEST_F(LimitsTest, ConnectionsOfOneAreCounted) {
  std::vector<int> open;
  for (int i = 0; i < 4; ++i) open.push_back(ConnectTcp(access_->address()));
  EXPECT_TRUE(Closed(ConnectTcp(access_->address())));
  for (const int fd : open) ::close(fd);
  // When they are gone, others come in.
  const wire::KeyAndCertificate anna = lab_.Make("observer", "anna");
  grpc::Status status;
  do {
    status = AnyCall(Dial(access_->address(), lab_.ca.certificate_pem, &anna),
                     "/mesorig.v1.Control/GetStatus")
                 .status;
  } while (status.error_code() == StatusCode::UNAVAILABLE);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

TEST_F(LimitsTest, StreamsOfOneAreCountedAndStopIsNot) {
  ASSERT_NO_FATAL_FAILURE(WatchOften(3));
  grpc::ClientContext more, stop;
  v1::StatusReply status;
  v1::StopReply stopped;
  EXPECT_EQ(control_->GetStatus(&more, v1::StatusRequest(), &status).error_code(),
            StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(control_->Stop(&stop, v1::StopRequest(), &stopped).ok());
  EndWatching();
}

TEST_F(LimitsTest, AStreamThatNobodyReadsIsCutOff) {
  SequencerEvent note;
  note.text = std::string(100'000, 'x');
  for (int i = 0; i < 100; ++i) sequencer_.Emit(note);
  grpc::ClientContext context;
  const auto stream = control_->Watch(&context, v1::WatchRequest());
  v1::Event event;
  ASSERT_TRUE(stream->Read(&event));
  while (access_->calls_under_way() > 0) std::this_thread::yield();
  int more = 0;
  while (stream->Read(&event)) ++more;
  EXPECT_LT(more, 99);
  EXPECT_EQ(stream->Finish().error_code(), StatusCode::CANCELLED);
  ExpectUnharmed();
}

}  // namespace
}  // namespace mesorig::daemon
