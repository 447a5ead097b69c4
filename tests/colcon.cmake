# `colcon test` runs the tests of the package that includes this file on what colcon has installed:
# the checkout comes last on PYTHONPATH, for the module `tests`.
get_filename_component(checkout ${CMAKE_CURRENT_LIST_DIR} DIRECTORY)
if(BUILD_TESTING)
  set(results ${AMENT_TEST_RESULTS_DIR}/${PROJECT_NAME}/pytest.xml)
  ament_add_test(pytest
    COMMAND python3 -m pytest -o pythonpath= -p no:cacheprovider -m "not slow and not checkout"
      --junit-xml=${results} ${checkout}/tests/${PROJECT_NAME}
    RESULT_FILE ${results}
    APPEND_ENV PYTHONPATH=${checkout}
    TIMEOUT 3600)
endif()
