mesorig_add_program(mesorig-processd
  SOURCES mesorig_processd.cc
  LINK mesorig::processing_service CLI11::CLI11)
