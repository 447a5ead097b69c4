/* Type support of any message, service or action, for Fast DDS and rclpy.
 *
 * A message in memory is its serialized body: deserializing walks the program that schema.py makes
 * of the type's definition, and converting to and from a Python object is done in Python (codec.py).
 * So one table serves every type, and no code is generated.
 *
 * This file includes no header of ROS and none of Python: it declares the structures of ROS 2 Jazzy
 * that it shares (names as in rosidl's headers), and pulls numbers out of Fast CDR through the type
 * supports of std_msgs' UInt8 to UInt64, which onebot_types_configure() checks first.
 *
 * The middleware calls most of these functions while it holds its own locks, and other threads wait
 * for those locks with Python's interpreter lock held. So only the two convert_ functions may touch
 * Python: rclpy calls them with the interpreter lock and outside the middleware.
 *
 * Fast CDR reports bytes that end too early by a C++ exception, which passes through these
 * functions: build with -fexceptions, and keep a message valid at every call that may throw.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "_program.h"

#define EXPORT __attribute__((visibility("default")))
enum { COMMON, FAST_DDS, INTROSPECTION, HANDLES, SIZES = 4, ENCAPSULATION = 4 };

/* ---- Python, by its stable ABI ---- */

typedef struct _object PyObject;
extern PyObject *PyBytes_FromStringAndSize(const char *, intptr_t);
extern char *PyBytes_AsString(PyObject *);
extern int PyBytes_AsStringAndSize(PyObject *, char **, intptr_t *);
extern PyObject *PyErr_NoMemory(void);
extern PyObject *PyObject_CallFunctionObjArgs(PyObject *, ...);
extern void Py_DecRef(PyObject *);

/* ---- Structures of rosidl_runtime_c ---- */

struct type_hash { uint8_t version, value[32]; };

struct handle {
  const char *identifier;
  const void *data;
  const struct handle *(*func)(const struct handle *, const char *);
  const struct type_hash *(*get_type_hash)(const struct handle *);
  const void *(*get_type_description)(const struct handle *);
  const void *(*get_type_description_sources)(const struct handle *);
};

struct service_handle {
  const char *identifier;
  const void *data;
  const struct service_handle *(*func)(const struct service_handle *, const char *);
  const struct handle *request, *response, *event;
  void *(*create_event)(const void *, void *, const void *, const void *);
  bool (*destroy_event)(void *, void *);
  const struct type_hash *(*get_type_hash)(const struct service_handle *);
  const void *(*get_type_description)(const struct service_handle *);
  const void *(*get_type_description_sources)(const struct service_handle *);
};

struct action_handle {
  const struct service_handle *goal, *result, *cancel;
  const struct handle *feedback, *status;
  const struct type_hash *(*get_type_hash)(const struct action_handle *);
  const void *(*get_type_description)(const struct action_handle *);
  const void *(*get_type_description_sources)(const struct action_handle *);
};

/* ---- Structures of rosidl_typesupport_fastrtps_cpp and rosidl_typesupport_introspection_c ---- */

struct callbacks {
  const char *message_namespace, *message_name;
  bool (*cdr_serialize)(const void *message, void *cdr);
  bool (*cdr_deserialize)(void *cdr, void *message);
  uint32_t (*get_serialized_size)(const void *message);
  size_t (*max_serialized_size)(char *bounds_info);
  const void *key_callbacks;
};

struct members {
  const char *message_namespace, *message_name;
  uint32_t member_count;
  size_t size_of;
  bool has_any_key_member;
  const void *members;
  void (*init_function)(void *, int);
  void (*fini_function)(void *);
};

struct service_members {
  const char *service_namespace, *service_name;
  const struct handle *request, *response;
};

/* ---- Types: made once, and kept as long as the process lives ---- */

struct facts { /* of a type, given by type_support.py */
  struct type_hash hash;
  const void *description, *sources;
};

struct message_type {
  struct {
    struct handle handle; /* first: a handle leads to its type */
    struct message_type *type;
  } handles[HANDLES];
  struct callbacks callbacks;
  struct members members;
  struct facts facts;
  const unsigned char *block; /* programs, as schema.py makes them */
  uint32_t program;
  PyObject *pack, *unpack;
};

struct service_type {
  struct {
    struct service_handle handle;
    struct service_type *type;
  } handles[HANDLES];
  struct service_members members;
  struct facts facts;
};

struct action_type {
  struct action_handle handle;
  struct facts facts;
};

/* What onebot_types_configure() finds; constant afterwards. */
static const struct callbacks *numbers[SIZES]; /* of 1, 2, 4 and 8 bytes */
static const char *identifiers[HANDLES];

/* ---- Messages in memory ---- */

struct message {
  const struct message_type *type;
  unsigned char *body;
  size_t size, capacity;
};

static bool reserve(struct message *message, size_t more)
{
  if (message->capacity - message->size >= more) {
    return true;
  }
  const size_t capacity = 2 * message->capacity + more;
  unsigned char *body = realloc(message->body, capacity);
  if (!body) {
    return false;
  }
  message->body = body;
  message->capacity = capacity;
  return true;
}

EXPORT void *onebot_types_create(const struct message_type *type)
{
  struct message *message = calloc(1, sizeof(*message));
  if (message) {
    message->type = type;
  }
  return message;
}

EXPORT void onebot_types_destroy(void *message)
{
  if (message) {
    free(((struct message *)message)->body);
    free(message);
  }
}

/* Nobody makes a message of ours by these two: its type would not be known. */
static void message_init(void *message, int initialization)
{
  (void)initialization;
  memset(message, 0, sizeof(struct message));
}

static void message_fini(void *message)
{
  free(((struct message *)message)->body);
  message_init(message, 0);
}

/* ---- Fast CDR ---- */

/* Append `count` numbers of `size` bytes each. A count may be a lie: memory grows only as numbers
 * really arrive. */
static bool pull_numbers(struct message *message, void *cdr, const struct operation *operation,
                         uint32_t size, uint64_t count)
{
  const struct callbacks *number = numbers[size == 8 ? 3 : size / 2];
  const size_t padding = -message->size & (size - 1);
  if (!reserve(message, padding)) {
    return false;
  }
  memset(message->body + message->size, 0, padding);
  message->size += padding;
  for (uint64_t i = 0; i < count; ++i) {
    if (!reserve(message, size) ||
        !number->cdr_deserialize(cdr, message->body + message->size) ||
        (operation->booleans && message->body[message->size] > 1)) {
      return false;
    }
    message->size += size;
  }
  return true;
}

static bool pull_structs(struct message *message, void *cdr, uint32_t number, uint64_t count)
{
  const unsigned char *block = message->type->block;
  const struct program *program = (const struct program *)block + number;
  const struct operation *first = (const struct operation *)(block + program->operations_at);
  static const struct operation a_length = {0};
  for (uint64_t item = 0; item < count; ++item) {
    for (const struct operation *operation = first; operation < first + program->operations;
         ++operation) {
      uint32_t length = operation->count;
      if (operation->kind != NUMBERS && !length) {
        if (!pull_numbers(message, cdr, &a_length, sizeof(length), 1)) {
          return false;
        }
        memcpy(&length, message->body + message->size - sizeof(length), sizeof(length));
      }
      if (length && !(operation->kind == STRUCTS
                        ? pull_structs(message, cdr, operation->program, length)
                        : pull_numbers(message, cdr, operation, operation->size, length))) {
        return false; /* and there is no padding before nothing */
      }
    }
  }
  return true;
}

static bool cdr_deserialize(void *cdr, void *untyped)
{
  struct message *message = untyped;
  message->size = 0;
  return pull_structs(message, cdr, message->type->program, 1);
}

static bool cdr_serialize(const void *untyped, void *cdr)
{
  const struct message *message = untyped;
  size_t at = 0;
  for (; message->size - at >= 8; at += 8) { /* aligned, so that nothing is put between */
    if (!numbers[3]->cdr_serialize(message->body + at, cdr)) {
      return false;
    }
  }
  for (; at < message->size; ++at) {
    if (!numbers[0]->cdr_serialize(message->body + at, cdr)) {
      return false;
    }
  }
  return true;
}

static uint32_t get_serialized_size(const void *message)
{
  return (uint32_t)((const struct message *)message)->size;
}

static size_t max_serialized_size(char *bounds_info)
{
  *bounds_info = 0; /* unbounded */
  return sizeof(uint32_t);
}

/* ---- Python objects ---- */

/* The type's `pack` makes the body of an object. */
EXPORT bool onebot_types_convert_from_py(PyObject *object, void *untyped)
{
  struct message *message = untyped;
  PyObject *body = PyObject_CallFunctionObjArgs(message->type->pack, object, NULL);
  char *data;
  intptr_t size;
  bool good = body && PyBytes_AsStringAndSize(body, &data, &size) == 0;
  message->size = 0;
  if (good && !reserve(message, (size_t)size)) {
    PyErr_NoMemory();
    good = false;
  }
  if (good && size) {
    memcpy(message->body, data, (size_t)size);
    message->size = (size_t)size;
  }
  Py_DecRef(body);
  return good;
}

/* The type's `unpack` makes an object of a whole message, which begins with its encapsulation. */
EXPORT PyObject *onebot_types_convert_to_py(void *untyped)
{
  static const char encapsulation[ENCAPSULATION] = {0, 1, 0, 0}; /* as numbers are in memory here */
  const struct message *message = untyped;
  PyObject *data = PyBytes_FromStringAndSize(NULL, (intptr_t)(ENCAPSULATION + message->size));
  if (!data) {
    return NULL;
  }
  memcpy(PyBytes_AsString(data), encapsulation, ENCAPSULATION);
  if (message->size) {
    memcpy(PyBytes_AsString(data) + ENCAPSULATION, message->body, message->size);
  }
  PyObject *object = PyObject_CallFunctionObjArgs(message->type->unpack, data, NULL);
  Py_DecRef(data);
  return object;
}

/* ---- Handles ---- */

static int find(const char *identifier)
{
  int i = 0;
  while (i < HANDLES && strcmp(identifiers[i], identifier) != 0) {
    ++i;
  }
  return i;
}

/* The functions of a handle: `type` is the structure that it is the first part of. */
#define FUNCTIONS(kind, handle_type, type)                                     \
  static const struct type_hash *kind##_hash(const struct handle_type *handle) \
  {                                                                            \
    return &(type)->facts.hash;                                                \
  }                                                                            \
  static const void *kind##_description(const struct handle_type *handle)      \
  {                                                                            \
    return (type)->facts.description;                                          \
  }                                                                            \
  static const void *kind##_sources(const struct handle_type *handle)          \
  {                                                                            \
    return (type)->facts.sources;                                              \
  }
#define MESSAGE_TYPE (*(struct message_type *const *)(handle + 1))
#define SERVICE_TYPE (*(struct service_type *const *)(handle + 1))
FUNCTIONS(message, handle, MESSAGE_TYPE)
FUNCTIONS(service, service_handle, SERVICE_TYPE)
FUNCTIONS(action, action_handle, (const struct action_type *)handle)

static const struct handle *find_message(const struct handle *handle, const char *identifier)
{
  const int i = find(identifier);
  return i < HANDLES ? &MESSAGE_TYPE->handles[i].handle : NULL;
}

static const struct service_handle *find_service(
  const struct service_handle *handle, const char *identifier)
{
  const int i = find(identifier);
  return i < INTROSPECTION ? &SERVICE_TYPE->handles[i].handle : NULL;
}

/* Introspection of services (service_msgs) is not supported: rcl says so where it gets no event. */
static void *create_event(const void *info, void *allocator, const void *request, const void *response)
{
  (void)info, (void)allocator, (void)request, (void)response;
  return NULL;
}

static bool destroy_event(void *event, void *allocator)
{
  (void)allocator;
  return event == NULL;
}

/* ---- Making types; NULL without memory ---- */

/* Make a message type and return its handle. The names are as in rosidl's C++ ("pkg::msg") and C
 * ("pkg__msg"); all that is pointed to must stay. */
EXPORT const struct handle *onebot_types_message(
  const char *cpp_namespace, const char *c_namespace, const char *name, const struct facts *facts,
  uint32_t member_count, const void *members, const unsigned char *block, uint32_t program,
  PyObject *pack, PyObject *unpack)
{
  struct message_type *type = calloc(1, sizeof(*type));
  if (!type) {
    return NULL;
  }
  type->callbacks = (struct callbacks){
    cpp_namespace, name, cdr_serialize, cdr_deserialize, get_serialized_size, max_serialized_size,
    NULL};
  type->members = (struct members){
    c_namespace, name, member_count, sizeof(struct message), false, members, message_init,
    message_fini};
  type->facts = *facts;
  type->block = block;
  type->program = program;
  type->pack = pack;
  type->unpack = unpack;
  const void *data[HANDLES] = {NULL, &type->callbacks, &type->members};
  for (int i = 0; i < HANDLES; ++i) {
    type->handles[i].handle = (struct handle){
      identifiers[i], data[i], find_message, message_hash, message_description, message_sources};
    type->handles[i].type = type;
  }
  return &type->handles[COMMON].handle;
}

/* Return the type of a handle of ours, for onebot_types_create(). */
EXPORT const struct message_type *onebot_types_of(const struct handle *handle)
{
  return MESSAGE_TYPE;
}

EXPORT const struct service_handle *onebot_types_service(
  const char *cpp_namespace, const char *name, const struct facts *facts,
  const struct handle *request, const struct handle *response, const struct handle *event)
{
  struct service_type *type = calloc(1, sizeof(*type));
  if (!type) {
    return NULL;
  }
  type->members = (struct service_members){
    cpp_namespace, name, request->func(request, identifiers[FAST_DDS]),
    response->func(response, identifiers[FAST_DDS])};
  type->facts = *facts;
  for (int i = 0; i < HANDLES; ++i) {
    type->handles[i].handle = (struct service_handle){
      identifiers[i], i == FAST_DDS ? &type->members : NULL, find_service, request, response, event,
      create_event, destroy_event, service_hash, service_description, service_sources};
    type->handles[i].type = type;
  }
  return &type->handles[COMMON].handle;
}

EXPORT const struct action_handle *onebot_types_action(
  const struct facts *facts, const struct service_handle *goal, const struct service_handle *result,
  const struct service_handle *cancel, const struct handle *feedback, const struct handle *status)
{
  struct action_type *type = calloc(1, sizeof(*type));
  if (!type) {
    return NULL;
  }
  type->handle = (struct action_handle){
    goal, result, cancel, feedback, status, action_hash, action_description, action_sources};
  type->facts = *facts;
  return &type->handle;
}

/* ---- Configuration ---- */

/* Check and keep the handles of std_msgs' UInt8, UInt16, UInt32 and UInt64; to be called once,
 * before anything else. Returns NULL, or what is not as expected: then nothing else may be used. */
EXPORT const char *onebot_types_configure(const struct handle *const handles[SIZES])
{
  static const char *const wanted[HANDLES] = {
    NULL, "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"};
  static const char *const names[SIZES] = {"UInt8", "UInt16", "UInt32", "UInt64"};
  for (int i = 0; i < SIZES; ++i) {
    const struct handle *found[HANDLES] = {handles[i]};
    for (int j = FAST_DDS; j < HANDLES; ++j) {
      found[j] = handles[i]->func(handles[i], wanted[j]);
      if (!found[j] || !found[j]->identifier || strcmp(found[j]->identifier, wanted[j]) != 0) {
        return "std_msgs has no type support for Fast DDS, or none for introspection";
      }
    }
    const struct callbacks *callbacks = found[FAST_DDS]->data;
    const struct members *members = found[INTROSPECTION]->data;
    if (strcmp(callbacks->message_namespace, "std_msgs::msg") != 0 ||
        strcmp(callbacks->message_name, names[i]) != 0 || members->member_count != 1 ||
        members->size_of != (size_t)1 << i) {
      return "messages are laid out in memory in an unknown way";
    }
    numbers[i] = callbacks;
    for (int j = 0; j < HANDLES; ++j) {
      identifiers[j] = found[j]->identifier; /* rmw compares them by address */
    }
  }
  return NULL;
}

#ifndef ONEBOT_SOURCE_DIGEST
#define ONEBOT_SOURCE_DIGEST "unknown"
#endif
/* Of the sources when they were compiled: reveals a library that is older than they are. */
EXPORT const char onebot_source_digest[] = ONEBOT_SOURCE_DIGEST;
