#include "daemon/service/call_table.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>

#include <cstdlib>
#include <set>

#include "protocol/base/file_writer.h"
#include "protocol/messages/control.pb.h"
#include "protocol/messages/frames.pb.h"
#include "protocol/messages/operations.pb.h"
#include "protocol/wire/identity.h"

namespace mesorig::daemon {
namespace {

// Every method of every service in the files of messages that mesorigd serves.
std::set<std::string> MethodsServed() {
  std::set<std::string> methods;
  for (const auto* file : {v1::HelloRequest::descriptor()->file(),
                           v1::SessionRequest::descriptor()->file(),
                           v1::DiagnoseRequest::descriptor()->file()}) {
    for (int i = 0; i < file->service_count(); ++i) {
      const auto* service = file->service(i);
      for (int j = 0; j < service->method_count(); ++j) {
        methods.insert(service->name() + "/" + service->method(j)->name());
      }
    }
  }
  return methods;
}

TEST(CallTable, HasEveryMethodOfEveryServiceOnceAndNoOther) {
  std::set<std::string> listed;
  for (const CallRule& rule : CallTable()) {
    EXPECT_TRUE(listed.emplace(rule.method).second) << rule.method << " is there twice";
    EXPECT_NE(rule.least, Role::kNone) << rule.method;
  }
  const std::set<std::string> served = MethodsServed();
  EXPECT_GE(served.size(), 22u);
  for (const std::string& method : served) {
    EXPECT_TRUE(listed.contains(method)) << method << " is not in daemon/service/call_table.cc";
  }
  for (const std::string& method : listed) {
    if (method.starts_with("/")) continue;  // of another package
    EXPECT_TRUE(served.contains(method)) << method << " is no method of ours";
  }
}

std::string Rendered() {
  std::string text =
      "| call | observer | processing | operator | administrator | lease | audited |\n"
      "| --- | --- | --- | --- | --- | --- | --- |\n";
  for (const CallRule& rule : CallTable()) {
    text += fmt::format("| {} |", rule.method);
    for (int role = 1; role < kRoles; ++role) {
      text += static_cast<Role>(role) >= rule.least ? " ✓ |" : " |";
    }
    text += rule.lease == Lease::kHeld ? " ✓ |" : " |";
    text += rule.audited ? " ✓ |\n" : " |\n";
  }
  return text;
}

TEST(CallTable, IsTheOneInTheDocumentation) {
  const std::string file = std::string(MESORIG_SOURCE_DIR) + "/docs/access.md";
  const std::string begin = "<!-- calls: begin -->\n", end = "<!-- calls: end -->";
  std::string text = ReadFile(file).value();
  const size_t from = text.find(begin), to = text.find(end);
  ASSERT_NE(from, std::string::npos);
  ASSERT_NE(to, std::string::npos);
  const size_t at = from + begin.size();
  const bool same = text.substr(at, to - at) == Rendered();
  if (std::getenv("MESORIG_UPDATE_DOCS") != nullptr) {
    text.replace(at, to - at, Rendered());
    ASSERT_TRUE(WriteFileAtomically(file, text).ok());
    return;
  }
  EXPECT_TRUE(same) << "docs/access.md has another table. To write this one there: "
                       "MESORIG_UPDATE_DOCS=1 daemon_service_test "
                       "--gtest_filter=CallTable.IsTheOneInTheDocumentation";
}

TEST(CallTable, FindsByPath) {
  ASSERT_NE(FindRule("/mesorig.v1.Control/Run"), nullptr);
  EXPECT_EQ(FindRule("/mesorig.v1.Control/Run")->least, Role::kOperator);
  for (const char* other : {"", "/", "/mesorig.v1.Control/run", "/mesorig.v1.Control/",
                            "/mesorig.v2.Control/Run", "/mesorig.v1.Control/Run/", "/x/y"}) {
    EXPECT_EQ(FindRule(other), nullptr) << other;
  }
}

TEST(CallTable, AnybodyWhoIsLetInMayStop) {
  const CallRule* stop = FindRule("/mesorig.v1.Control/Stop");
  ASSERT_NE(stop, nullptr);
  EXPECT_EQ(stop->least, Role::kObserver);
  EXPECT_EQ(stop->lease, Lease::kNone);
  EXPECT_TRUE(stop->audited);
}

TEST(CallTable, RolesHaveNames) {
  for (int i = 0; i < kRoles; ++i) {
    const Role role = static_cast<Role>(i);
    EXPECT_EQ(RoleNamed(Name(role)), role) << Name(role);
  }
  for (const std::string_view role : wire::kCertificateRoles) {
    EXPECT_EQ(RoleNamed(role) == Role::kNone, role == "gateway" || role == "daemon") << role;
  }
  EXPECT_EQ(RoleNamed(""), Role::kNone);
}

}  // namespace
}  // namespace mesorig::daemon
