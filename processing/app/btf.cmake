mesorig_add_program(mesorig-btf
  SOURCES btf_tool.cc bench_command.cc btf_commands.cc encode_options.cc mdf_commands.cc stripe_command.cc btf_cross_validate.cc btf_report.cc png_file.cc progress_bar.cc
  LINK mesorig::protocol_base mesorig::processing_btf mesorig::codecs_encode
       mesorig::processing_exchange mesorig::processing_report mesorig::processing_image
       mesorig::processing_mesostructure PkgConfig::stb)
