/* The type support of tf2_msgs/msg/TFMessage, put together from that of geometry_msgs.
 *
 * No Python package provides tf2_msgs, and its generated code would need ROS at build time. So this
 * file includes no header of ROS and none of Python: it declares the few structures of ROS 2 Jazzy
 * that it shares (names as in rosidl's headers), and gets everything else at run time from the
 * type supports of TransformStamped and UInt32, which onebot_tf_configure() checks first.
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

#define EXPORT __attribute__((visibility("default")))
#define LENGTH(array) (sizeof(array) / sizeof((array)[0]))

/* ---- Structures of rosidl_runtime_c ---- */

struct string { char *data; size_t size, capacity; };

struct field_type {
  uint8_t type_id;
  uint64_t capacity, string_capacity;
  struct string nested_type_name;
};
struct field { struct string name; struct field_type type; struct string default_value; };
struct field_sequence { struct field *data; size_t size, capacity; };
struct individual_description { struct string type_name; struct field_sequence fields; };
struct individual_sequence { struct individual_description *data; size_t size, capacity; };
struct type_description {
  struct individual_description type;
  struct individual_sequence referenced;
};
struct type_source { struct string type_name, encoding, raw_file_contents; };
struct source_sequence { struct type_source *data; size_t size, capacity; };
struct type_hash { uint8_t version, value[32]; };

struct handle {
  const char *identifier;
  const void *data;
  const struct handle *(*func)(const struct handle *, const char *);
  const struct type_hash *(*get_type_hash)(const struct handle *);
  const struct type_description *(*get_type_description)(const struct handle *);
  const struct source_sequence *(*get_type_description_sources)(const struct handle *);
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

struct member {
  const char *name;
  uint8_t type_id;
  size_t string_upper_bound;
  const struct handle *members;
  bool is_key, is_array;
  size_t array_size;
  bool is_upper_bound;
  uint32_t offset;
  const void *default_value;
  size_t (*size_function)(const void *);
  const void *(*get_const_function)(const void *, size_t);
  void *(*get_function)(void *, size_t);
  void (*fetch_function)(const void *, size_t, void *);
  void (*assign_function)(void *, size_t, const void *);
  bool (*resize_function)(void *, size_t);
};

struct members {
  const char *message_namespace, *message_name;
  uint32_t member_count;
  size_t size_of;
  bool has_any_key_member;
  const struct member *members;
  void (*init_function)(void *, int);
  void (*fini_function)(void *);
};

enum { INIT_ALL = 0, TYPE_STRING = 16, TYPE_MESSAGE = 18, NESTED_UNBOUNDED_SEQUENCE = 145 };

/* ---- The messages in memory ---- */

struct time { int32_t sec; uint32_t nanosec; };
struct header { struct time stamp; struct string frame_id; };
struct transform { double translation[3], rotation[4]; };
struct transform_stamped {
  struct header header;
  struct string child_frame_id;
  struct transform transform;
};
struct tf_message { struct transform_stamped *data; size_t size, capacity; };

/* ---- Python, by its stable ABI ---- */

typedef struct _object PyObject;
extern PyObject *PyErr_NoMemory(void);
extern PyObject *PyList_New(intptr_t);
extern int PyList_SetItem(PyObject *, intptr_t, PyObject *); /* takes over the reference */
extern PyObject *PyObject_CallObject(PyObject *, PyObject *);
extern PyObject *PyObject_GetAttrString(PyObject *, const char *);
extern int PyObject_SetAttrString(PyObject *, const char *, PyObject *);
extern PyObject *PySequence_Tuple(PyObject *);
extern PyObject *PyTuple_GetItem(PyObject *, intptr_t); /* lends the reference */
extern intptr_t PyTuple_Size(PyObject *);
extern void Py_DecRef(PyObject *);
extern void Py_IncRef(PyObject *);

/* ---- What onebot_tf_configure() finds; constant afterwards ---- */

static const struct callbacks *transform_callbacks, *count_callbacks;
static const struct members *transform_members;
static bool (*transform_from_py)(PyObject *, void *);
static PyObject *(*transform_to_py)(void *);
static PyObject *message_class;

/* ---- Memory: all elements up to the capacity are initialized, always ---- */

static void message_fini(void *untyped)
{
  struct tf_message *message = untyped;
  for (size_t i = 0; i < message->capacity; ++i) {
    transform_members->fini_function(&message->data[i]);
  }
  free(message->data);
  memset(message, 0, sizeof(*message));
}

static bool message_reserve(struct tf_message *message, size_t capacity)
{
  if (capacity <= message->capacity) {
    return true;
  }
  if (capacity > SIZE_MAX / sizeof(*message->data)) {
    return false;
  }
  struct transform_stamped *data = realloc(message->data, capacity * sizeof(*data));
  if (!data) {
    return false;
  }
  message->data = data;
  memset(&data[message->capacity], 0, (capacity - message->capacity) * sizeof(*data));
  for (; message->capacity < capacity; ++message->capacity) {
    transform_members->init_function(&data[message->capacity], INIT_ALL);
  }
  return true;
}

static bool message_resize(void *untyped, size_t size)
{
  struct tf_message *message = untyped;
  message_fini(message);
  if (!message_reserve(message, size)) {
    return false;
  }
  message->size = size;
  return true;
}

static void message_init(void *message, int initialization)
{
  (void)initialization; /* every way to initialize an empty sequence is this one */
  memset(message, 0, sizeof(struct tf_message));
}

EXPORT void *onebot_tf_create(void)
{
  return calloc(1, sizeof(struct tf_message));
}

EXPORT void onebot_tf_destroy(void *message)
{
  if (message) {
    message_fini(message);
    free(message);
  }
}

/* ---- Fast CDR ---- */

static bool cdr_serialize(const void *untyped, void *cdr)
{
  const struct tf_message *message = untyped;
  uint32_t count = (uint32_t)message->size;
  if (count != message->size || !count_callbacks->cdr_serialize(&count, cdr)) {
    return false;
  }
  for (size_t i = 0; i < message->size; ++i) {
    if (!transform_callbacks->cdr_serialize(&message->data[i], cdr)) {
      return false;
    }
  }
  return true;
}

static bool cdr_deserialize(void *cdr, void *untyped)
{
  /* The count may be a lie. Memory grows only as elements really arrive: a message that claims
   * more than it holds ends in Fast CDR's exception, having cost twice its honest size at most. */
  enum { FIRST_CAPACITY = 256 };
  struct tf_message *message = untyped;
  uint32_t count = 0;
  message_fini(message);
  if (!count_callbacks->cdr_deserialize(cdr, &count)) {
    return false;
  }
  while (message->size < count) {
    if (message->size == message->capacity) {
      size_t wanted = message->capacity ? 2 * message->capacity : FIRST_CAPACITY;
      if (!message_reserve(message, wanted < count ? wanted : count)) {
        return false;
      }
    }
    if (!transform_callbacks->cdr_deserialize(cdr, &message->data[message->size])) {
      return false;
    }
    ++message->size;
  }
  return true;
}

static size_t align(size_t position, size_t alignment)
{
  return (position + alignment - 1) / alignment * alignment;
}

static uint32_t get_serialized_size(const void *untyped)
{
  /* Exact, because rmw_serialize() returns that many bytes. TransformStamped's own function answers
   * for a start at 0 only, but alignment depends on the start: the first element is at 4. */
  const struct tf_message *message = untyped;
  size_t position = sizeof(uint32_t);
  for (size_t i = 0; i < message->size; ++i) {
    const struct transform_stamped *item = &message->data[i];
    position = align(position, 4) + sizeof(struct time);
    position = position + sizeof(uint32_t) + item->header.frame_id.size + 1;
    position = align(position, 4) + sizeof(uint32_t) + item->child_frame_id.size + 1;
    position = align(position, 8) + sizeof(struct transform);
  }
  return (uint32_t)position;
}

static size_t max_serialized_size(char *bounds_info)
{
  *bounds_info = 0; /* unbounded */
  return sizeof(uint32_t);
}

/* ---- Introspection ---- */

static size_t get_size(const void *message)
{
  return ((const struct tf_message *)message)->size;
}

static const void *get_const_item(const void *message, size_t index)
{
  return &((const struct tf_message *)message)->data[index];
}

static void *get_item(void *message, size_t index)
{
  return &((struct tf_message *)message)->data[index];
}

static void fetch_item(const void *message, size_t index, void *value)
{
  memcpy(value, get_const_item(message, index), sizeof(struct transform_stamped));
}

static void assign_item(void *message, size_t index, const void *value)
{
  memcpy(get_item(message, index), value, sizeof(struct transform_stamped));
}

/* ---- Description and hash ---- */

#define STRING(text) {(char *)text, sizeof(text) - 1, sizeof(text) - 1}
#define TYPE_NAME "tf2_msgs/msg/TFMessage"
#define ITEM_NAME "geometry_msgs/msg/TransformStamped"

static const struct type_hash type_hash = {1, {
  0xe3, 0x69, 0xd0, 0xf0, 0x5a, 0x23, 0xae, 0x52, 0x50, 0x88, 0x54, 0xb6, 0x6f, 0x6a, 0xa0, 0x43,
  0x7f, 0x34, 0x49, 0xd6, 0x52, 0xe8, 0xcb, 0xf2, 0x2d, 0x5a, 0xbe, 0x85, 0xd0, 0x20, 0xf0, 0x87}};
static const struct type_hash transform_hash = {1, {
  0x0a, 0x24, 0x1f, 0x87, 0xd0, 0x46, 0x68, 0xd9, 0x40, 0x99, 0xcb, 0xb5, 0xba, 0x11, 0x69, 0x1d,
  0x5a, 0xd3, 0x2c, 0x2f, 0x29, 0x68, 0x2e, 0x4e, 0xb5, 0x65, 0x34, 0x24, 0xbd, 0x27, 0x52, 0x06}};

static struct field fields[] = {
  {STRING("transforms"), {NESTED_UNBOUNDED_SEQUENCE, 0, 0, STRING(ITEM_NAME)}, {NULL, 0, 0}}};
static struct individual_description referenced[6];
static struct type_description description = {
  {STRING(TYPE_NAME), {fields, LENGTH(fields), LENGTH(fields)}},
  {referenced, LENGTH(referenced), LENGTH(referenced)}};
static struct type_source source_list[1 + LENGTH(referenced)] = {
  {STRING(TYPE_NAME), STRING("msg"), STRING("geometry_msgs/TransformStamped[] transforms")}};
static const struct source_sequence sources = {
  source_list, LENGTH(source_list), LENGTH(source_list)};

static const struct type_hash *get_type_hash(const struct handle *handle)
{
  (void)handle;
  return &type_hash;
}

static const struct type_description *get_type_description(const struct handle *handle)
{
  (void)handle;
  return &description;
}

static const struct source_sequence *get_type_description_sources(const struct handle *handle)
{
  (void)handle;
  return &sources;
}

/* ---- The three handles: the one that rclpy passes on, and the two it stands for ---- */

static const struct handle *get_handle(const struct handle *, const char *);

static const struct callbacks message_callbacks = {
  "tf2_msgs::msg", "TFMessage", cdr_serialize, cdr_deserialize, get_serialized_size,
  max_serialized_size, NULL};
static struct member message_member[] = {{
  .name = "transforms", .type_id = TYPE_MESSAGE, .is_array = true, .size_function = get_size,
  .get_const_function = get_const_item, .get_function = get_item, .fetch_function = fetch_item,
  .assign_function = assign_item, .resize_function = message_resize}};
static const struct members message_members = {
  "tf2_msgs__msg", "TFMessage", LENGTH(message_member), sizeof(struct tf_message), false,
  message_member, message_init, message_fini};

#define HANDLE(data) \
  {NULL, data, get_handle, get_type_hash, get_type_description, get_type_description_sources}
static struct handle fastrtps_handle = HANDLE(&message_callbacks);
static struct handle introspection_handle = HANDLE(&message_members);
EXPORT struct handle onebot_tf_handle = HANDLE(NULL);

static const struct handle *get_handle(const struct handle *handle, const char *identifier)
{
  const struct handle *known[] = {&fastrtps_handle, &introspection_handle, &onebot_tf_handle};
  (void)handle;
  for (size_t i = 0; i < LENGTH(known); ++i) {
    if (strcmp(known[i]->identifier, identifier) == 0) {
      return known[i];
    }
  }
  return NULL;
}

/* ---- Python objects ---- */

EXPORT bool onebot_tf_convert_from_py(PyObject *object, void *untyped)
{
  struct tf_message *message = untyped;
  PyObject *field = PyObject_GetAttrString(object, "transforms");
  /* A tuple of our own: another thread may change the list while an element is converted. */
  PyObject *items = field ? PySequence_Tuple(field) : NULL;
  bool good = items != NULL;
  if (good && !message_resize(message, (size_t)PyTuple_Size(items))) {
    PyErr_NoMemory();
    good = false;
  }
  for (size_t i = 0; good && i < message->size; ++i) {
    good = transform_from_py(PyTuple_GetItem(items, (intptr_t)i), &message->data[i]);
  }
  Py_DecRef(items);
  Py_DecRef(field);
  return good;
}

EXPORT PyObject *onebot_tf_convert_to_py(void *untyped)
{
  struct tf_message *message = untyped;
  PyObject *object = PyObject_CallObject(message_class, NULL);
  PyObject *list = object ? PyList_New((intptr_t)message->size) : NULL;
  bool good = list != NULL;
  for (size_t i = 0; good && i < message->size; ++i) {
    PyObject *item = transform_to_py(&message->data[i]);
    good = item && PyList_SetItem(list, (intptr_t)i, item) == 0;
  }
  good = good && PyObject_SetAttrString(object, "transforms", list) == 0;
  Py_DecRef(list);
  if (!good) {
    Py_DecRef(object);
    object = NULL;
  }
  return object;
}

/* ---- Configuration ---- */

static const void *find_data(
  const struct handle *handle, const char *identifier, const char **found)
{
  const struct handle *special = handle->func(handle, identifier);
  if (!special || !special->identifier || strcmp(special->identifier, identifier) != 0) {
    return NULL;
  }
  *found = special->identifier; /* rmw compares identifiers by address: ours must be these */
  return special->data;
}

static bool is_member(const struct member *member, const char *name, uint8_t type_id, size_t offset)
{
  return strcmp(member->name, name) == 0 && member->type_id == type_id &&
         member->offset == offset && !member->is_array;
}

static bool is_layout_known(const struct members *stamped)
{
  const struct member *member = stamped->members;
  if (strcmp(stamped->message_namespace, "geometry_msgs__msg") != 0 ||
      strcmp(stamped->message_name, "TransformStamped") != 0 || stamped->member_count != 3 ||
      stamped->size_of != sizeof(struct transform_stamped) ||
      !is_member(&member[0], "header", TYPE_MESSAGE, offsetof(struct transform_stamped, header)) ||
      !is_member(&member[1], "child_frame_id", TYPE_STRING,
                 offsetof(struct transform_stamped, child_frame_id)) ||
      !is_member(&member[2], "transform", TYPE_MESSAGE,
                 offsetof(struct transform_stamped, transform))) {
    return false;
  }
  const struct members *header = member[0].members->data;
  const struct members *transform = member[2].members->data;
  return header->member_count == 2 && header->size_of == sizeof(struct header) &&
         is_member(&header->members[0], "stamp", TYPE_MESSAGE, offsetof(struct header, stamp)) &&
         is_member(&header->members[1], "frame_id", TYPE_STRING,
                   offsetof(struct header, frame_id)) &&
         transform->size_of == sizeof(struct transform);
}

static bool describe(const struct handle *stamped)
{
  /* What TFMessage refers to is what TransformStamped refers to and itself, sorted by name. */
  const struct type_description *from = stamped->get_type_description(stamped);
  const struct source_sequence *from_sources = stamped->get_type_description_sources(stamped);
  const size_t others = LENGTH(referenced) - 1;
  if (!from || from->referenced.size != others || !from_sources ||
      from_sources->size != 1 + others) {
    return false;
  }
  size_t own = 0;
  while (own < others && strcmp(from->referenced.data[own].type_name.data, ITEM_NAME) < 0) {
    ++own;
  }
  for (size_t i = 0; i < LENGTH(referenced); ++i) {
    const size_t other = i < own ? i : i - 1; /* not used for i == own */
    referenced[i] = i == own ? from->type : from->referenced.data[other];
    source_list[1 + i] = from_sources->data[i == own ? 0 : 1 + other];
  }
  return true;
}

/* Check and keep what this file builds on; to be called once, before anything else.
 *
 * stamped, count: type support handles of geometry_msgs/TransformStamped and std_msgs/UInt32.
 * from_py, to_py: TransformStamped's converters. class: what a received message is made of.
 * Returns NULL, or what is not as expected: then nothing else here may be used.
 */
EXPORT const char *onebot_tf_configure(
  const struct handle *stamped, const struct handle *count, bool (*from_py)(PyObject *, void *),
  PyObject *(*to_py)(void *), PyObject *class)
{
  static const char fastrtps[] = "rosidl_typesupport_fastrtps_c";
  static const char introspection[] = "rosidl_typesupport_introspection_c";
  const struct type_hash *hash = stamped->get_type_hash ? stamped->get_type_hash(stamped) : NULL;
  const char *ignored;
  if (!hash || memcmp(hash, &transform_hash, sizeof(transform_hash)) != 0) {
    return "geometry_msgs/TransformStamped is not that of ROS 2 Jazzy";
  }
  transform_callbacks = find_data(stamped, fastrtps, &fastrtps_handle.identifier);
  count_callbacks = find_data(count, fastrtps, &ignored);
  if (!transform_callbacks || !count_callbacks) {
    return "geometry_msgs or std_msgs has no type support for Fast DDS";
  }
  transform_members = find_data(stamped, introspection, &introspection_handle.identifier);
  const struct members *count_members = find_data(count, introspection, &ignored);
  if (!transform_members || !count_members) {
    return "geometry_msgs or std_msgs has no type support for introspection";
  }
  if (!is_layout_known(transform_members) || count_members->size_of != sizeof(uint32_t) ||
      strcmp(transform_callbacks->message_namespace, "geometry_msgs::msg") != 0 ||
      strcmp(transform_callbacks->message_name, "TransformStamped") != 0 ||
      strcmp(count_callbacks->message_namespace, "std_msgs::msg") != 0 ||
      strcmp(count_callbacks->message_name, "UInt32") != 0) {
    return "messages are laid out in memory in an unknown way";
  }
  if (!describe(stamped)) {
    return "geometry_msgs/TransformStamped describes itself in an unknown way";
  }
  message_member[0].members = stamped->func(stamped, introspection);
  onebot_tf_handle.identifier = stamped->identifier;
  transform_from_py = from_py;
  transform_to_py = to_py;
  Py_IncRef(class);
  message_class = class;
  return NULL;
}

#ifndef ONEBOT_SOURCE_DIGEST
#define ONEBOT_SOURCE_DIGEST "unknown"
#endif
/* Of the sources when they were compiled: reveals a library that is older than they are. */
EXPORT const char onebot_source_digest[] = ONEBOT_SOURCE_DIGEST;
