mesorig_add_test(processing_btf_tool_test
  SOURCES btf_tool_test.cc
  LINK mesorig::processing_btf nlohmann_json::nlohmann_json
  DEPENDS mesorig-btf)
