// A validator for the part of JSON Schema 2020-12 that the contract uses, to check real replies.

const types = {
  object: (v) => v !== null && typeof v === 'object' && !Array.isArray(v), array: Array.isArray,
  string: (v) => typeof v === 'string', number: (v) => typeof v === 'number', integer: Number.isInteger,
  boolean: (v) => typeof v === 'boolean', null: (v) => v === null,
};
const known = new Set(['$ref', '$defs', '$schema', '$id', '$comment', 'title', 'description', 'default', 'examples', 'type', 'enum', 'const',
  'properties', 'required', 'additionalProperties', 'patternProperties', 'propertyNames', 'items', 'prefixItems', 'minItems', 'maxItems',
  'minimum', 'maximum', 'exclusiveMinimum', 'exclusiveMaximum', 'minLength', 'maxLength', 'pattern', 'oneOf', 'anyOf', 'allOf',
  'not', 'contentMediaType', 'minProperties', 'maxProperties', 'uniqueItems', 'readOnly', 'deprecated', 'format', 'multipleOf',
  'dependentRequired', 'if', 'then', 'else']);

/** @returns {string[]} errors with their places; empty = valid */
export function validate(value, schema, root = schema, at = '') {
  if (schema === true || schema === undefined) return [];
  if (schema === false) return [`${at}: not allowed`];
  const faults = [];
  const say = (text) => faults.push(`${at || '/'}: ${text}`);
  for (const word of Object.keys(schema)) if (!known.has(word)) say(`the schema's "${word}" is not understood`);
  if (schema.$ref) {
    const target = schema.$ref.split('/').slice(1).reduce((node, name) => node?.[name], root);
    if (!target) return [`${at}: ${schema.$ref} leads nowhere`];
    faults.push(...validate(value, target, root, at));
  }
  if (schema.type && ![schema.type].flat().some((type) => types[type](value))) say(`is not ${schema.type}`);
  if (schema.enum && !schema.enum.includes(value)) say(`${JSON.stringify(value)} is not in the list`);
  if ('const' in schema && value !== schema.const) say(`is not ${JSON.stringify(schema.const)}`);
  if (typeof value === 'number') {
    if (value < schema.minimum) say(`is below ${schema.minimum}`);
    if (value > schema.maximum) say(`is above ${schema.maximum}`);
    if (value <= schema.exclusiveMinimum) say(`is not above ${schema.exclusiveMinimum}`);
    if (value >= schema.exclusiveMaximum) say(`is not below ${schema.exclusiveMaximum}`);
  }
  if (typeof value === 'string') {
    if (value.length < schema.minLength || value.length > schema.maxLength) say('has the wrong length');
    if (schema.pattern && !new RegExp(schema.pattern, 'u').test(value)) say(`does not match ${schema.pattern}`);
  }
  if (Array.isArray(value)) {
    if (value.length < schema.minItems || value.length > schema.maxItems) say('has the wrong number of items');
    value.forEach((item, i) => faults.push(...validate(item, schema.prefixItems?.[i] ?? schema.items, root, `${at}/${i}`)));
  } else if (types.object(value)) {
    for (const name of schema.required ?? []) if (!Object.hasOwn(value, name)) say(`lacks "${name}"`);
    for (const [name, item] of Object.entries(value)) {
      const patterns = Object.entries(schema.patternProperties ?? {}).filter(([pattern]) => new RegExp(pattern, 'u').test(name));
      const own = schema.properties?.[name];
      for (const part of [own, ...patterns.map(([, part]) => part)]) if (part !== undefined) faults.push(...validate(item, part, root, `${at}/${name}`));
      if (own === undefined && !patterns.length) faults.push(...validate(item, schema.additionalProperties, root, `${at}/${name}`));
    }
  }
  const choices = (list) => list.filter((choice) => validate(value, choice, root, at).length === 0).length;
  if (schema.oneOf && choices(schema.oneOf) !== 1) say('fits not exactly one choice');
  if (schema.anyOf && choices(schema.anyOf) === 0) say('fits no choice');
  for (const part of schema.allOf ?? []) faults.push(...validate(value, part, root, at));
  if (schema.not && validate(value, schema.not, root, at).length === 0) say('fits what it must not');
  return faults;
}
